"""Write the report of the check as Markdown: docs/paper.md."""

from rattle.paper.derivations import DERIVATIONS, NOT_CHECKED, NOT_HELD
from rattle.paper.numbers import PROVED
from rattle.paper.records import Report, StatedNumber

HEAD = """\
# The paper, checked

J. F. Mason and P. T. Piiroinen, *The effect of codimension-two bifurcations on the global dynamics of a gear
model*, SIAM J. Appl. Dyn. Syst. 8 (2009) 1694–1711. Every number and statement in it that can be computed, for β =
0.6, and where it is wrong or incomplete. This file is what `rattle paper --markdown` prints.
"""

RULE = """\
A number agrees if it lies within half a unit of the last digit that the paper gives, within one unit where the
paper writes ≈. An interval agrees only as a whole. Computed values that are called proved are enclosed to less than
1e-14 by a theorem (docs/proofs.md).
"""


def format_computed(number: StatedNumber) -> str:
    """Return the computed number as text, such as "0.1234567890, proved". An interval has seven decimals."""
    if isinstance(number.computed, tuple):
        return "{:.7f} to {:.7f}".format(*number.computed)
    return f"{number.computed:.10f}" + (", proved" if number.what in PROVED else "")


def difference(number: StatedNumber) -> str:
    """Return the computed number minus the printed one as text, with two decimals more than the paper gives."""
    return f"{number.difference:+.{2 - int(number.printed_value.as_tuple().exponent)}f}"


def verdict(report: Report, number: StatedNumber) -> str:
    """Return the verdict on a number as text; a finding that explains a deviation is added: "off: finding 3"."""
    return f"{number.verdict}: finding {report.finding_number(number.finding)}" if number.finding else number.verdict


def escape_table_cell(text: str) -> str:
    """Return a text for a table cell, with each | escaped, because | would end the cell."""
    return text.replace("|", "\\|")


def markdown(report: Report) -> str:
    """Return the whole report as a Markdown document."""
    numbers = [
        f"| {x.where} | {x.what} | {x.paper} | {format_computed(x)} | {difference(x)} | {verdict(report, x)} |"
        for x in report.numbers
    ]
    statements = [
        f"| {x.where} | {escape_table_cell(x.says)} | {escape_table_cell(x.computed)} | {x.verdict} |"
        for x in report.statements
    ]
    findings = []
    for i, x in enumerate(report.findings, 1):
        evidence = [f"- {one.shows}{'' if one.holds else ' (NOT BORNE OUT)'}" for one in x.evidence]
        findings += [f"### {i}. {x.title}", "", f"Paper: {x.paper}", "", f"Instead: {x.instead}", "", *evidence, ""]
    parts = [
        HEAD,
        "## Numbers",
        "",
        RULE,
        "| where | what | paper | computed | difference | verdict |\n|---|---|---|---|---|---|",
        *numbers,
        "",
        "## Statements",
        "",
        "| where | the paper says | computed | verdict |\n|---|---|---|---|",
        *statements,
        "",
        "## Where the paper is wrong or incomplete",
        "",
        *findings,
        "## Derivations",
        "",
        DERIVATIONS,
        "## Not held against the paper",
        "",
        NOT_HELD,
        "## Not checked, or only so far",
        "",
        NOT_CHECKED,
    ]
    return "\n".join(parts).rstrip() + "\n"
