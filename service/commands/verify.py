"""``rattle verify``: check that a store is undamaged."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from gear_rattle.workers import StoreIntegrity
    from gear_rattle.workers.certificates import CertificatesIntegrity

DAMAGED = 1  # exit status if a file is damaged or lost
MAX_DAMAGED_LINES = 20  # largest number of damaged files that are printed


def verify(
    store: Annotated[
        str, typer.Argument(metavar="STORE", help="Path or s3:// URL of a survey, a population or certificates.")
    ],
    processes: Annotated[int, typer.Option(min=1, help="Processes that read tiles; the output is the same.")] = 1,
) -> None:
    """Compare every file of a store with its checksum. The exit status is 1 if a file is damaged or lost.

    The files of a survey are its cells, curves, families and levels, and the certificates beside it. In a completed
    survey a missing chunk counts as lost. The command that computed the survey, or POST /v1/surveys/ID/verify, computes
    only the damaged parts again.
    """
    from gear_rattle.workers import examine, place_of
    from gear_rattle.workers.certificates import (
        examine_certificates,
        examine_certificates_beside_survey,
        is_certificate_store,
    )

    place, damaged = place_of(store), list[str]()
    if is_certificate_store(place):
        certificates = [examine_certificates(place.path)]  # type: ignore[union-attr]  # a directory
    else:
        found, certificates = examine(place, processes), examine_certificates_beside_survey(place)
        _print_survey_integrity(found, str(place))
        damaged += [f"tile {tile}: {', '.join(names)}" for tile, names in found.damaged.items()]
        damaged += found.template
    for each in certificates:
        _print_certificates_integrity(each)
        damaged += [f"{each.path.name}/{name}" for name in each.damaged]
    for what in damaged[:MAX_DAMAGED_LINES]:
        typer.echo(f"damaged: {what}")
    if len(damaged) > MAX_DAMAGED_LINES:
        typer.echo(f"and {len(damaged) - MAX_DAMAGED_LINES} more")
    if damaged:
        raise typer.Exit(DAMAGED)


def _print_survey_integrity(found: StoreIntegrity, where: str) -> None:
    state = f"completed {found.completed}" if found.completed else "not completed"
    typer.echo(f"{where}: computed by version {found.version or 'unknown'}, {state}")
    if found.was_checked_by_decoding:
        typer.echo(
            f"{found.files:,} chunks decoded, {len(found.template):,} damaged. This version cannot read the checksums "
            "of the store: verify the store with the version that made it, to find lost or exchanged chunks"
        )
        return
    missing = found.tiles - len(found.done) - len(found.damaged)
    typer.echo(
        f"{found.files:,} files read: {found.tiles:,} tiles, {len(found.done):,} whole, {len(found.damaged):,} "
        f"damaged, {missing:,} not computed yet; {len(found.template):,} of the other files damaged"
    )


def _print_certificates_integrity(found: CertificatesIntegrity) -> None:
    if found.complete:
        typer.echo(f"{found.path}: certificates, {found.files:,} files read, {len(found.damaged):,} damaged")
    else:
        typer.echo(f"{found.path}: certificates are unfinished, so they have no checksums and are not verified")
