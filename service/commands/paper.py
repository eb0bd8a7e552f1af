"""``rattle paper``: the paper's numbers and statements beside the computed ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rattle.paper import Report

WIDTH = 140  # numbers are never cut, whatever the terminal
UNEXPECTED = 1


def paper(
    markdown: Annotated[bool, typer.Option("--markdown", help="Print docs/paper.md, derivations and all.")] = False,
) -> None:
    """Compute every number of Mason and Piiroinen (2009) and show where the paper is wrong or incomplete.

    Exit status 1 if a number or statement is off and no finding takes that up, or a finding is not borne out.
    """
    from rattle import paper as checks

    report = checks.report()
    if markdown:
        typer.echo(checks.markdown(report), nl=False)
    else:
        _show(report)
    for what in report.unexpected:
        typer.echo(f"rattle: unexpected: {what}", err=True)
    if report.unexpected:
        raise typer.Exit(UNEXPECTED)


def _show(report: Report) -> None:
    from rich.console import Console
    from rich.table import Table

    from rattle.paper.document import RULE, difference, value, verdict

    console = Console(highlight=False, markup=False, width=WIDTH)
    numbers = Table(box=None)
    for heading in ("where", "what", "paper", "computed", "difference", "verdict"):
        numbers.add_column(heading, no_wrap=heading != "what")
    for number in report.numbers:
        numbers.add_row(
            number.where, number.what, number.paper, value(number), difference(number), verdict(report, number)
        )
    statements = Table("where", "the paper says", "computed", "verdict", box=None)
    for statement in report.statements:
        statements.add_row(statement.where, statement.says, statement.computed, statement.verdict)
    console.print(numbers, RULE, statements, "\nWhere the paper is wrong or incomplete\n", sep="\n")
    for i, finding in enumerate(report.findings, 1):
        console.print(f"{i}. {finding.title}\n   Paper: {finding.paper}\n   Instead: {finding.instead}")
        for one in finding.evidence:
            console.print(f"   - {one.shows}{'' if one.holds else ' (NOT BORNE OUT)'}")
        console.print()
