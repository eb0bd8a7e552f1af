"""``rattle explain``: explain the boundaries of a survey."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from gear_rattle.service.commands.options import Slice

if TYPE_CHECKING:
    from gear_rattle.workers.boundaries.explain import BoundaryExplanation

WIDTH = 160  # characters in a line, enough for all numbers, however wide the terminal is
UNEXPLAINED = 1  # exit status if a boundary of regions has no curve


def explain(
    store: Annotated[str, typer.Argument(metavar="STORE", help="Path or URL of a survey's store.")],
    most_curves: Annotated[
        int,
        typer.Option(
            "--curves", min=0, help="Largest number of curves to compute besides those of the period-one motions."
        ),
    ] = 100,
    rows: Annotated[int, typer.Option(min=1, help="Largest number of rows of each table.")] = 25,
    slice_: Slice = None,
) -> None:
    """Name the bifurcation curve that passes between each two neighbouring cells of a survey that differ.

    Cells differ in their region or in their set of attractors. A survey with families also shows where cells differ
    only because samples missed a motion. The exit status is 1 if a boundary of regions has no curve.
    """
    from gear_rattle.service.results import open_results
    from gear_rattle.workers.boundaries.explain import explain as explained
    from gear_rattle.workers.survey.slices import select_slice, slice_group_path

    with open_results(store) as whole:
        dataset = select_slice(whole, slice_)
        families = (
            open_results(store, group=slice_group_path(slice_, "families")) if "attractor_family" in dataset else None
        )
        found = explained(dataset, most_curves, families)
    _print_explanation(found, rows)
    if found.region_explained.sum() < found.pairs.region.sum():
        raise typer.Exit(UNEXPLAINED)


def _print_explanation(found: BoundaryExplanation, rows: int) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False, width=WIDTH)
    pairs = found.pairs
    console.print(f"{len(pairs)} pairs of neighbouring cells differ in their region or their attractors.")
    for what, number, of in (
        ("between which a computed curve passes", found.crossed.sum(), len(pairs)),
        ("whose regions differ, explained", found.region_explained.sum(), pairs.region.sum()),
        ("whose attractors differ by the sample alone", found.differ_by_samples_only.sum(), pairs.attractors.sum()),
        (
            "whose attractors differ otherwise, explained",
            found.attractors_explained.sum(),
            pairs.attractors.sum() - found.differ_by_samples_only.sum(),
        ),
    ):
        share = f"{100 * number / of:.1f} %" if of else "-"
        console.print(f"  {what}: {number} of {of} ({share})")
    console.print(
        f"  of these, by the point of a curve between the two cells alone: {found.n_pairs_with_followed_bifurcation}"
    )
    table = Table(
        "curve", "pairs it explains", "pairs it passes between", box=None, title="Curves", title_justify="left"
    )
    crossing = [item for item in found.explaining_curves if item.crosses.any()]
    for item in crossing[:rows]:
        table.add_row(item.curve.name, str(item.n_explained_pairs), str(item.crosses.sum()))
    console.print(table)
    if len(crossing) > rows:
        console.print(f"  and {len(crossing) - rows} curves more")
    if not found.unexplained_groups:
        return
    table = Table("what changes", "pairs", "why no curve", "for example, (delta, epsilon)", box=None, title="The rest")
    table.title_justify = "left"
    for rest in found.unexplained_groups[:rows]:
        example = " | ".join(f"({delta:.6g}, {epsilon:.6g})" for delta, epsilon in rest.example)
        table.add_row(rest.change, str(rest.n_pairs), rest.why, example)
    console.print(table)
    if others := found.unexplained_groups[rows:]:
        console.print(f"  and {len(others)} kinds more, {sum(x.n_pairs for x in others)} pairs")
