"""Export a survey to a file for other programs, some rows of cells at a time, to save memory."""

import tempfile
from collections.abc import Hashable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO

import numpy as np
import xarray as xr

from gear_rattle.workers.errors import SurveyError, report_damage
from gear_rattle.workers.storage.complex import split_complex
from gear_rattle.workers.survey.machine import AXES
from gear_rattle.workers.survey.slices import slices_of, third_axis_length
from gear_rattle.workers.survey.values.schema import CELL, FIXED, RowForm
from rattle import MissingExtraError

ROWS = 32  # rows of a band, if the dataset does not say how many rows the store's chunks have
CELLS = 16_384  # at most this many rows of a table are converted to text at a time


#: {form of a table: (the dimension whose entries have a row each, the variable that says whether an entry exists)}.
OWN_ROWS = {RowForm.ATTRACTORS: ("attractor", "attractor_kind"), RowForm.ORBITS: ("orbit", "orbit_exists")}


def write_netcdf(dataset: xr.Dataset, groups: Mapping[str, xr.Dataset] | None = None) -> IO[bytes]:
    """Write an open survey to a NetCDF 4 file under the CF conventions. groups: {path of a group: dataset}.

    Returns
    -------
    IO[bytes]
        The file, open at its beginning. It has no name on disk any more, so it vanishes when it is closed.
    """
    rows = _rows_per_band(dataset)
    with tempfile.TemporaryDirectory(prefix="rattle-") as directory:
        path = Path(directory) / "survey.nc"
        # All variables are written at once: opening the file for each took most of the time of a small survey.
        whole = split_complex(dataset.chunk({"epsilon": rows, **dict.fromkeys(third_axis_length(dataset), 1)}))
        whole.attrs = {name: value for name, value in whole.attrs.items() if value is not None}
        _write_group(whole, path, "w", rows)
        for group, each in (groups or {}).items():
            _write_group(split_complex(each), path, "a", rows, group)
        return path.open("rb")


def _write_group(dataset: xr.Dataset, path: Path, mode: str, rows: int, group: str | None = None) -> None:
    encoding: dict[Hashable, dict[str, object]] = {}
    for name, values in dataset.data_vars.items():
        encoding[name] = {"zlib": True, "complevel": 1} if values.ndim else {}
        if values.ndim and values.dtype.kind in "biuf":  # only numbers and flags: HDF5 has no checksums of texts
            encoding[name]["fletcher32"] = True
        # Chunks are as high as a band, because HDF5 would compress a higher chunk again for each of its bands.
        if values.dims[-2:] == CELL:
            height, width = min(rows, values.shape[-2]), values.shape[-1]
            encoding[name]["chunksizes"] = (*(1 for _ in values.shape[:-2]), height, width)
    written = dataset.to_netcdf(path, mode=mode, group=group, engine="h5netcdf", encoding=encoding, compute=False)  # type: ignore[call-overload]
    written.compute(scheduler="synchronous")  # dask writes the bands one by one in this process, never on a cluster


def _rows_per_band(dataset: xr.Dataset) -> int:
    """Return how many rows of cells to export at a time: the rows of a tile if the dataset states them, else ROWS."""
    return int(dataset["status"].encoding.get("preferred_chunks", {}).get("epsilon", ROWS))


def require_readable_variables(dataset: xr.Dataset, names: Sequence[Hashable] | None = None) -> None:
    """Raise DamageError unless variables (by default all) can be read, before their export is sent to a client."""
    rows = _rows_per_band(dataset)
    for name in dataset.variables if names is None else names:
        for one in slices_of(dataset[[name]]):
            _check_bands_for_damage(one[name], rows)


def _check_bands_for_damage(values: xr.DataArray, rows: int) -> None:
    """Read a variable, some rows at a time, to find damage. Raises DamageError if a part cannot be read."""
    for start in range(0, values.sizes.get("epsilon", 1), rows):
        with report_damage(f"{values.name} of this survey"):
            np.asarray(values.isel(epsilon=slice(start, start + rows)) if "epsilon" in values.dims else values)


def names_of_column_variables(dataset: xr.Dataset, form: RowForm = RowForm.CELLS) -> list[str]:
    """Return the names of the variables that become columns. Raises SurveyError if there are none for this form."""
    own = OWN_ROWS.get(form, (None,))[0]

    def is_column(dims: tuple[Hashable, ...]) -> bool:
        return dims[-2:] == CELL and (dims == CELL if own is None else dims[0] == own)

    names = [str(name) for name, values in next(slices_of(dataset)).data_vars.items() if is_column(values.dims)]
    if not names:
        raise SurveyError(
            f"this survey was computed without {form}: use the form cells, which has a row for every cell"
        )
    return names


def table_bands(dataset: xr.Dataset, form: RowForm = RowForm.CELLS) -> Iterator[dict[str, np.ndarray]]:
    """Yield the table of an open survey in bands of rows.

    δ varies fastest, then ε, then a third axis. In the forms `attractors` and `orbits` there is a row for each existing
    attractor or orbit. A variable with a further dimension, such as the number of an exponent, has a column for each
    value of that dimension.

    Yields
    ------
    dict[str, np.ndarray]
        Columns of a band, by name.
    """
    for one in slices_of(dataset):
        yield from _yield_bands_of_slice(one, form)


def _yield_bands_of_slice(dataset: xr.Dataset, form: RowForm) -> Iterator[dict[str, np.ndarray]]:
    names, rows = names_of_column_variables(dataset, form), _rows_per_band(dataset)
    beside = [name for name in AXES if name in dataset.variables]
    fixed = {name: float(dataset[name]) for name in FIXED if name in dataset.coords}
    for start in range(0, dataset.sizes["epsilon"], rows):
        band = slice(start, start + rows)
        some = split_complex(dataset[names].isel(epsilon=band).load())  # older stores have complex arrays
        height, width = some.sizes["epsilon"], some.sizes["delta"]
        columns = {"delta": np.tile(some["delta"].values, height), "epsilon": np.repeat(some["epsilon"].values, width)}
        columns |= {name: np.full(height * width, value) for name, value in fixed.items()}
        columns |= {
            name: _repeat_for_cells(dataset[name].isel(epsilon=band, missing_dims="ignore"), some.sizes)
            for name in beside
        }
        if form in OWN_ROWS:
            yield _columns_of_attractors_or_orbits(some, list(map(str, some.data_vars)), columns, *OWN_ROWS[form])
        else:
            yield columns | {str(name): values.values.ravel() for name, values in some.data_vars.items()}


def _repeat_for_cells(values: xr.DataArray, sizes: Mapping[Hashable, int]) -> np.ndarray:
    """Repeat the values of a variable along δ or along ε, such as a machine's speeds, so that each cell has one.

    sizes: the numbers of cells along δ and ε.

    Returns
    -------
    np.ndarray
        A value for each cell, row by row.
    """
    if values.dims == ("delta",):
        return np.tile(values.values, sizes["epsilon"])
    return np.repeat(values.values, sizes["delta"])


def _columns_of_attractors_or_orbits(
    dataset: xr.Dataset, names: Sequence[str], cell_columns: Mapping[str, np.ndarray], dimension: str, existence: str
) -> dict[str, np.ndarray]:
    """Return the columns of a table with a row for each attractor, or each orbit, of some cells.

    names: the variables that become columns. cell_columns: columns with a value for each cell, by name. dimension: the
    dimension of attractors or orbits. existence: the variable that is 0 where an attractor or orbit does not exist.

    Returns
    -------
    dict[str, np.ndarray]
        Columns by name.
    """
    there = dataset[existence].transpose(*CELL, dimension).values.ravel() != 0 if existence in dataset else None
    labels = dataset[dimension].values
    columns = {name: np.repeat(values, labels.size) for name, values in cell_columns.items()}
    columns[dimension] = np.tile(labels, next(iter(cell_columns.values())).size)
    for name in names:
        values = dataset[name].transpose(*CELL, *dataset[name].dims[:-2])
        if values.ndim == len(CELL) + 1:
            columns[name] = values.values.ravel()
            continue
        besides = values.dims[-1]
        for label in dataset[besides].values:
            columns[f"{name}_{label}"] = values.sel({besides: label}).values.ravel()
    return columns if there is None else {name: values[there] for name, values in columns.items()}


def csv_lines(dataset: xr.Dataset, form: RowForm = RowForm.CELLS) -> Iterator[str]:
    """Yield a table as CSV text, several lines at a time."""
    for number, columns in enumerate(table_bands(dataset, form)):
        if number == 0:
            yield ",".join(columns) + "\r\n"
        for first in range(0, next(iter(columns.values())).size, CELLS):
            texts = [_convert_numbers_to_text(column[first : first + CELLS]) for column in columns.values()]
            yield "".join(",".join(row) + "\r\n" for row in zip(*texts, strict=True))


def write_parquet(dataset: xr.Dataset, form: RowForm = RowForm.CELLS) -> IO[bytes]:
    """Write a table to a Parquet file, with the attributes of the survey as its metadata.

    Returns
    -------
    IO[bytes]
        The file, open at its beginning. Its directory is deleted already, so the file is lost when it is closed.

    Raises
    ------
    MissingExtraError
        pyarrow is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ModuleNotFoundError as error:
        raise MissingExtraError("Parquet needs pyarrow: pip install 'gear-rattle[parquet]'") from error
    about = {name: str(value) for name, value in dataset.attrs.items()}
    with tempfile.TemporaryDirectory(prefix="rattle-") as directory:
        path = Path(directory) / "survey.parquet"
        writer = None
        for columns in table_bands(dataset, form):
            table = pyarrow.table({name: np.asarray(values) for name, values in columns.items()})
            writer = writer or parquet.ParquetWriter(path, table.schema.with_metadata(about))
            writer.write_table(table)
        if writer is not None:
            writer.close()
        return path.open("rb")


def _convert_numbers_to_text(column: np.ndarray) -> list[str]:
    """Convert numbers to text that reads back to the same value; NaN becomes empty text."""
    if column.dtype == bool:
        column = column.astype(np.int8)
    if column.dtype == np.float32:  # as a double, the float32 0.1 would be written 0.10000000149011612
        return ["" if np.isnan(value) else str(value) for value in column]
    if column.dtype.kind not in "iuf":
        return [str(value) for value in column]
    return ["" if value != value else repr(value) for value in column.tolist()]
