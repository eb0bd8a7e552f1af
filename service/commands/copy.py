"""``rattle copy``: copy a store to a directory, a bucket, a zip file, an Icechunk repository, or NetCDF."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer


def copy(
    source: Annotated[str, typer.Argument(metavar="SRC", help="Path, s3:// URL or .zip of a survey's store.")],
    target: Annotated[
        str,
        typer.Argument(metavar="DST", help="Path, s3:// URL, .zip, .icechunk or .nc that does not exist yet."),
    ],
) -> None:
    """Copy a survey to a directory, bucket (s3://BUCKET/PREFIX), zip file, Icechunk repository or NetCDF file.

    The ending of DST chooses the kind. Every file is compared with its checksum at the source and at the destination;
    NetCDF has checksums of its own. The same command continues an interrupted copy, or begins it again for a zip file,
    an Icechunk repository or NetCDF. Certificates beside a survey are not copied.
    """
    for each in (source, target):
        if "://" in each and not each.startswith("s3://"):
            raise typer.BadParameter(f"{each} is neither a path nor s3://BUCKET/PREFIX: give a path or an s3:// URL")
    if target.endswith(".nc"):
        from gear_rattle.service.commands.export import export

        export(source, Path(target))
        return
    from gear_rattle.service.commands.progress import ProgressReporter, create_reporter
    from gear_rattle.workers.storage.copy import copy_store

    with ExitStack() as stack:
        shown: list[ProgressReporter] = []

        def show(done: int, total: int) -> None:
            if not shown:
                shown.append(stack.enter_context(create_reporter(total, what="files")))
            shown[0].show_cells_done(done)

        copied = copy_store(source, target, show)
    kept = f", {copied.kept:,} of them were there already" if copied.kept else ""
    typer.echo(f"{target} is complete: {copied.files:,} files, {copied.size:,} bytes, all checksums agree{kept}.")
