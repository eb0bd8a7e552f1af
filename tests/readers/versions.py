"""Find the versions of libraries that read a survey, each in its own environment: the table in other-languages.md.

``make readers-table`` writes it. It needs a network once, uv, and a Python 3.12 for GDAL.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zarr

from gear_rattle.workers import Group, run_survey
from gear_rattle.workers.storage.export import write_netcdf
from gear_rattle.workers.storage.store import open_groups, open_survey

HERE = Path(__file__).parent
DOCUMENT = HERE.parents[1] / "docs" / "how-to" / "other-languages.md"
BEGIN, END = "<!-- readers: make readers-table writes this table -->\n", "<!-- end of readers -->"
OTHER_BITS = 1e-9  # of a sum, in another order


class Reader(NamedTuple):
    """A library that reads a store.

    Attributes
    ----------
    by
        The function of read.py.
    packages
        What is installed; the first has the version that the table names.
    note
        What the table adds to the number of arrays.
    python
        The version of Python that the packages need, if this one is too old for them.
    """

    by: str
    packages: tuple[str, ...]
    note: str = ""
    python: str = ""


READERS = (
    Reader("xarray", ("xarray", "zarr>=3")),
    Reader("xarray", ("xarray==2025.1.1", "zarr==3.0.0", "numpy<2.3")),
    Reader("zarr", ("zarr>=3",)),
    Reader("zarr", ("zarr==3.0.0", "numpy<2.3")),
    Reader("zarr", ("zarr==2.18.7", "numcodecs<0.16", "numpy<2.3")),
    Reader("tensorstore", ("tensorstore",), "these from the attribute `texts`, because it does not know zarr's text"),
    Reader("gdal", ("rasterio>=1.5",), python="3.12"),
    Reader("gdal_netcdf", ("rasterio>=1.5",), "the maps of the survey as NetCDF", python="3.12"),
    Reader("icechunk", ("icechunk", "xarray", "zarr>=3"), "those of the survey's root"),
    Reader("virtualizarr", ("virtualizarr[hdf]", "obstore", "xarray"), "those of the survey's root that are no texts"),
)


def survey_in(directory: Path) -> Path:
    """Compute a small survey with every group but basins, and write it as NetCDF beside."""
    store = directory / "survey.zarr"
    run_survey(
        delta=(0.55, 0.7, 3),
        epsilon=(0.05, 0.1, 2),
        initial_conditions={"count": 4},
        quantities=tuple(set(Group) - {Group.BASINS}),
        out=store,
    ).close()
    with open_survey(store, as_stored=True) as survey, write_netcdf(survey, open_groups(store)) as file:
        store.with_suffix(".nc").write_bytes(file.read())
    return store


def values_in(store: Path) -> dict[str, np.ndarray]:
    """Return every array as this package reads it."""
    root = zarr.open_group(store, mode="r")
    return {path: np.asarray(each[...]) for path, each in root.members(max_depth=None) if isinstance(each, zarr.Array)}


def checked(reader: Reader, store: Path, ours: dict[str, np.ndarray], directory: Path) -> str:
    """Read the store by a reader, compare each array, and return the row of the table.

    Raises
    ------
    AssertionError
        It reads other numbers.
    """
    python = directory / f"{reader.by}-{abs(hash(reader.packages))}" / "bin" / "python"
    uv = shutil.which("uv") or str(Path(sys.executable).with_name("uv"))
    version = ["--python", reader.python] if reader.python else []
    subprocess.run([uv, "venv", "--quiet", "--no-project", *version, str(python.parents[1])], check=True)
    subprocess.run([uv, "pip", "install", "--quiet", "--python", str(python), *reader.packages], check=True)
    frozen = subprocess.run([uv, "pip", "freeze", "--python", str(python)], capture_output=True, text=True, check=True)
    versions = dict(re.findall(r"^([\w.-]+)==(\S+)$", frozen.stdout, re.M))
    names = [re.split(r"[=<>\[]", package)[0] for package in reader.packages]
    shown = " with ".join(
        f"{name} {versions[name]}" for name in names if name in ("xarray", "zarr") or name == names[0]
    )
    if names[0] == "rasterio":
        ask = [str(python), "-c", "import rasterio; print(rasterio.__gdal_version__)"]
        shown = f"GDAL {subprocess.run(ask, capture_output=True, text=True, check=True).stdout.strip()} by {shown}"
    run = subprocess.run([python, HERE / "read.py", reader.by, store], capture_output=True, text=True, check=False)
    if run.returncode:
        last = run.stderr.strip().splitlines()[-1].replace("|", "/")
        return f"| {shown} | no: `{last[:120]}` |"
    read: dict[str, Any] = {each["path"]: each for each in map(json.loads, re.findall(r"^{.*$", run.stdout, re.M))}
    texts = [name for name, values in ours.items() if values.dtype.kind in "OUT"]
    for name, each in read.items():
        values = ours[name]
        if name in texts:
            assert each["texts"] == [str(one) for one in values.ravel().tolist()], name
        else:
            numbers = values.astype(float)
            assert each["nan"] == np.isnan(numbers).sum(), name
            total = numbers[np.isfinite(numbers)].sum()
            assert abs(each["sum"] - total) <= OTHER_BITS * max(1.0, abs(total)), name
    missing = set(ours) - set(read)
    said = f"{len(read)} arrays" if missing else f"every array, {len(texts)} of texts among them"
    return f"| {shown} | {said}{reader.note and ': '}{reader.note} |"


def table(directory: Path) -> str:
    """Return the table as Markdown."""
    store = survey_in(directory)
    ours = values_in(store)
    rows = [checked(reader, store, ours, directory) for reader in READERS]
    when = f"{datetime.now(UTC):%Y-%m}"
    return "\n".join([f"| read in {when} by | |", "|---|---|", *rows]) + "\n"


def main() -> None:
    """Write the table to the document."""
    with tempfile.TemporaryDirectory() as directory:
        made = table(Path(directory))
    text = DOCUMENT.read_text()
    DOCUMENT.write_text(text.partition(BEGIN)[0] + BEGIN + made + END + text.partition(END)[2])
    print(made)


if __name__ == "__main__":
    main()
