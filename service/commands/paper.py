"""``rattle paper``: compare the paper's numbers and statements with computed ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rattle.paper import Report

WIDTH = 140  # characters in a line, enough for all numbers, however wide the terminal is
UNEXPECTED = 1  # exit status if a number or statement differs unexpectedly, or the evidence of a finding fails


def paper(
    markdown: Annotated[bool, typer.Option("--markdown", help="Print docs/paper.md, with all derivations.")] = False,
    only: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER",
            help="Number of a finding to compute alone, with the numbers that it explains.",
            show_default="all",
        ),
    ] = None,
) -> None:
    """Compute every number of Mason and Piiroinen (2009) and show where the paper is wrong or incomplete.

    The last line is the summary. The exit status is 1 if a number or statement differs and no finding explains it, or
    if the evidence of a finding fails.
    """
    from rattle import paper as checks

    if markdown and only is not None:
        raise typer.BadParameter("--markdown writes all findings: leave --only out", param_hint="--markdown")
    report = checks.report() if only is None else checks.compute_finding(only)
    if markdown:
        typer.echo(checks.markdown(report), nl=False)
    else:
        _print_report(report)
    for what in report.deviations:
        typer.echo(f"rattle: unexpected: {what}", err=True)
    if report.deviations:
        raise typer.Exit(UNEXPECTED)


def _print_report(report: Report) -> None:
    from rich.console import Console
    from rich.table import Table

    from rattle.paper import RULE, difference, format_computed, verdict

    console = Console(highlight=False, markup=False, width=WIDTH)
    numbers = Table(box=None)
    for heading in ("where", "what", "paper", "computed", "difference", "verdict"):
        numbers.add_column(heading, no_wrap=heading != "what")
    for number in report.numbers:
        numbers.add_row(
            number.where,
            number.what,
            number.paper,
            format_computed(number),
            difference(number),
            verdict(report, number),
        )
    statements = Table("where", "the paper says", "computed", "verdict", box=None)
    for statement in report.statements:
        statements.add_row(statement.where, statement.says, statement.computed, statement.verdict)
    if report.numbers:
        console.print(numbers, RULE, sep="\n")
    if report.statements:
        console.print(statements)
    console.print("\nWhere the paper is wrong or incomplete\n")
    for i, finding in enumerate(report.findings, report.first):
        console.print(f"{i}. {finding.title}\n   Paper: {finding.paper}\n   Instead: {finding.instead}")
        for one in finding.evidence:
            console.print(f"   - {one.shows}{'' if one.holds else ' (NOT BORNE OUT)'}")
        console.print()
    console.print(report.summary)
