"""``rattle verify``: whether a store still holds what was computed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from workers import Integrity
    from workers.certificates import CertificatesIntegrity

DAMAGED = 1
MAX_LINES = 20


def verify(
    store: Annotated[
        str, typer.Argument(metavar="STORE", help="Path or s3:// URL of a survey, a population or certificates.")
    ],
) -> None:
    """Read every file of a store and compare it with its checksum. Exit status 1 if any is damaged or lost.

    Of a survey: its cells, curves, families and levels, and the certificates beside it. A chunk that is not there is
    lost once the survey was completed. The command that computed the survey, or POST /v1/surveys/ID/verify, computes
    again what is damaged, and only that.
    """
    from workers import examine, place_of
    from workers.certificates import examine_beside, examine_certificates, holds_certificates

    place = place_of(store)
    if holds_certificates(place):
        lines = _of_certificates(examine_certificates(place.path))  # type: ignore[union-attr]  # a directory
    else:
        lines = _of_survey(examine(place), str(place))
        for beside in examine_beside(place):
            lines += _of_certificates(beside)
    for line in lines[:MAX_LINES]:
        typer.echo(line)
    if len(lines) > MAX_LINES:
        typer.echo(f"and {len(lines) - MAX_LINES} more")
    if any(line.startswith(_BAD) for line in lines):
        raise typer.Exit(DAMAGED)


_BAD = "damaged: "


def _of_survey(found: Integrity, where: str) -> list[str]:
    state = f"completed {found.completed}" if found.completed else "not completed"
    lines = [f"{where}: computed by version {found.version or 'unknown'}, {state}"]
    if found.decoded:
        lines.append(
            f"{found.files:,} chunks decoded, {len(found.template)} damaged. It has no checksums that this version "
            "reads: whether chunks are lost or in another's place, only its own version tells"
        )
    else:
        lines.append(
            f"{found.files:,} files read: {found.tiles:,} tiles, {len(found.done):,} whole, {len(found.damaged):,} "
            f"damaged, {found.tiles - len(found.done) - len(found.damaged):,} not computed yet; of the other files "
            f"{len(found.template):,} damaged"
        )
    lines += [f"{_BAD}tile {tile}: {', '.join(names)}" for tile, names in found.damaged.items()]
    return lines + [f"{_BAD}{name}" for name in found.template]


def _of_certificates(found: CertificatesIntegrity) -> list[str]:
    if not found.complete:
        return [f"{found.path}: certificates, not all tried yet, so without checksums: not verified"]
    said = f"{found.path}: certificates, {found.files:,} files read, {len(found.damaged):,} damaged"
    return [said, *(f"{_BAD}{found.path.name}/{name}" for name in found.damaged)]
