"""A survey as a file for other programs, without ever holding more of it than one variable."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
import xarray as xr

from workers.schema import CELL

ROWS = 64  # of the grid that are written at a time


def write_netcdf(dataset: xr.Dataset) -> IO[bytes]:
    """Write an open survey as NetCDF 4; complex variables as pairs `…_real` and `…_imag`, which NetCDF has none of.

    Returns:
        The file, open at its beginning. It has no name any more: it is gone when it is closed, whatever happens.
    """
    with tempfile.TemporaryDirectory(prefix="rattle-") as directory:
        path = Path(directory) / "survey.nc"
        bare = dataset.drop_vars(list(dataset.data_vars))
        bare.attrs = {name: value for name, value in dataset.attrs.items() if value is not None}
        _append(bare, path, "w")
        for name in dataset.data_vars:
            _append(_without_complex(dataset[[name]]), path, "a")
        return path.open("rb")


def _append(dataset: xr.Dataset, path: Path, mode: str) -> None:
    compressed = {name: {"zlib": True, "complevel": 1} for name, values in dataset.data_vars.items() if values.ndim}
    for values in dataset.variables.values():
        values.encoding = {}  # zarr's means nothing here
    dataset.to_netcdf(path, mode=mode, engine="h5netcdf", encoding=compressed)  # type: ignore[call-overload]


def _without_complex(dataset: xr.Dataset) -> xr.Dataset:
    dataset = dataset.load().copy()
    for name in [name for name, values in dataset.data_vars.items() if np.iscomplexobj(values)]:
        values = dataset[name]
        for part in ("real", "imag"):
            dataset[f"{name}_{part}"] = getattr(values, part).assign_attrs(
                values.attrs | {"long_name": f"{values.attrs.get('long_name', name)}, {part} part"}
            )
        dataset = dataset.drop_vars([name])
    return dataset


def csv_lines(dataset: xr.Dataset) -> Iterator[str]:
    """The variables of an open survey over (epsilon, delta) alone as lines of CSV, a cell each, δ running first."""
    names = [str(name) for name, values in dataset.data_vars.items() if values.dims == CELL]
    delta, epsilon = (np.asarray(dataset[axis]) for axis in ("delta", "epsilon"))
    yield ",".join(["delta", "epsilon", *names]) + "\r\n"
    for start in range(0, epsilon.size, ROWS):
        some = dataset[names].isel(epsilon=slice(start, start + ROWS)).load()
        columns = [np.tile(delta, some.sizes["epsilon"]), np.repeat(some["epsilon"].values, delta.size)]
        columns += [some[name].values.ravel() for name in names]
        texts = [_texts(column) for column in columns]
        yield "".join(",".join(row) + "\r\n" for row in zip(*texts, strict=True))


def _texts(column: np.ndarray) -> list[str]:
    """Numbers that read back as they are; nothing for NaN."""
    if column.dtype == bool:
        column = column.astype(np.int8)
    if column.dtype == np.float32:  # or 0.1 would become 0.10000000149011612
        return ["" if np.isnan(value) else str(value) for value in column]
    return ["" if value != value else repr(value) for value in column.tolist()]
