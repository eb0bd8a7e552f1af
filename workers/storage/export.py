"""A survey as a file for other programs, a band of rows at a time: however large it is, it takes little memory."""

import tempfile
from collections.abc import Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO

import numpy as np
import xarray as xr

from workers.errors import reading
from workers.survey.machine import AXES
from workers.survey.values.schema import CELL

ROWS = 32  # of the grid, where the store does not say how many its chunks have
CELLS = 16_384  # that are text at the same time


def write_netcdf(dataset: xr.Dataset) -> IO[bytes]:
    """Write an open survey as NetCDF 4; complex variables as pairs `…_real` and `…_imag`, which NetCDF has none of.

    Returns:
        The file, open at its beginning. It has no name any more: it is gone when it is closed, whatever happens.
    """
    rows = _rows(dataset)
    with tempfile.TemporaryDirectory(prefix="rattle-") as directory:
        path = Path(directory) / "survey.nc"
        bare = dataset.drop_vars(list(dataset.data_vars))
        bare.attrs = {name: value for name, value in dataset.attrs.items() if value is not None}
        _append(bare, path, "w", rows)
        for name in dataset.data_vars:
            one = dataset[[name]]
            _append(_without_complex(one.chunk(epsilon=rows) if "epsilon" in one.dims else one), path, "a", rows)
        return path.open("rb")


def _append(dataset: xr.Dataset, path: Path, mode: str, rows: int) -> None:
    encoding: dict[Hashable, dict[str, object]] = {}
    for each in dataset.variables.values():
        each.encoding = {}  # zarr's means nothing here
    for name, values in dataset.data_vars.items():
        encoding[name] = {"zlib": True, "complevel": 1} if values.ndim else {}
        if values.dims[-2:] == CELL:  # or HDF5 would compress what a band is a part of again and again
            height, width = min(rows, values.shape[-2]), values.shape[-1]
            encoding[name]["chunksizes"] = (*(1 for _ in values.shape[:-2]), height, width)
    written = dataset.to_netcdf(path, mode=mode, engine="h5netcdf", encoding=encoding, compute=False)  # type: ignore[call-overload]
    written.compute(scheduler="synchronous")  # one band after the other, here, whatever cluster this process knows


def _rows(dataset: xr.Dataset) -> int:
    """Rows of the grid that one row of tiles has."""
    return int(dataset["status"].encoding.get("preferred_chunks", {}).get("epsilon", ROWS))


def _without_complex(dataset: xr.Dataset) -> xr.Dataset:
    for name in [name for name, values in dataset.data_vars.items() if np.iscomplexobj(values)]:
        values = dataset[name]
        for part in ("real", "imag"):
            dataset[f"{name}_{part}"] = getattr(values, part).assign_attrs(
                values.attrs | {"long_name": f"{values.attrs.get('long_name', name)}, {part} part"}
            )
        dataset = dataset.drop_vars([name])
    return dataset


def require_readable(dataset: xr.Dataset, names: Sequence[Hashable] | None = None) -> None:
    """Read these variables, or all: a file that is being sent cannot be taken back. Raises DamageError."""
    rows = _rows(dataset)
    for name in dataset.variables if names is None else names:
        values = dataset[name]
        height = values.sizes.get("epsilon", 1)
        for start in range(0, height, rows):
            with reading(f"{name} of this survey"):
                np.asarray(values.isel(epsilon=slice(start, start + rows)) if "epsilon" in values.dims else values)


def csv_lines(dataset: xr.Dataset) -> Iterator[str]:
    """The variables of an open survey over (epsilon, delta) alone as lines of CSV, a cell each, δ running first; of a
    machine's survey the speeds and eccentricities beside δ and ε.
    """
    names = csv_names(dataset)
    delta, epsilon = (np.asarray(dataset[axis]) for axis in ("delta", "epsilon"))
    beside = [name for name in AXES if name in dataset.variables]
    rows = _rows(dataset)
    yield ",".join(["delta", "epsilon", *beside, *names]) + "\r\n"
    for start in range(0, epsilon.size, rows):
        band = slice(start, start + rows)
        some = dataset[names].isel(epsilon=band).load()
        columns = [np.tile(delta, some.sizes["epsilon"]), np.repeat(some["epsilon"].values, delta.size)]
        columns += [_along(dataset[name].isel(epsilon=band, missing_dims="ignore"), some.sizes) for name in beside]
        columns += [some[name].values.ravel() for name in names]
        for first in range(0, columns[0].size, CELLS):
            texts = [_texts(column[first : first + CELLS]) for column in columns]
            yield "".join(",".join(row) + "\r\n" for row in zip(*texts, strict=True))


def _along(values: xr.DataArray, sizes: Mapping[Hashable, int]) -> np.ndarray:
    """What stands along one axis, in every cell of a band."""
    if values.dims == ("delta",):
        return np.tile(values.values, sizes["epsilon"])
    return np.repeat(values.values, sizes["delta"])


def csv_names(dataset: xr.Dataset) -> list[str]:
    """The variables that CSV has."""
    return [str(name) for name, values in dataset.data_vars.items() if values.dims == CELL]


def _texts(column: np.ndarray) -> list[str]:
    """Numbers that read back as they are; nothing for NaN."""
    if column.dtype == bool:
        column = column.astype(np.int8)
    if column.dtype == np.float32:  # or 0.1 would become 0.10000000149011612
        return ["" if np.isnan(value) else str(value) for value in column]
    return ["" if value != value else repr(value) for value in column.tolist()]
