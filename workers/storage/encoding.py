"""Set the encoding of an opened dataset, so that xarray can write it to other files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

#: Encodings that are kept. Chunks and codecs belong to the opened store, and would cause errors in another file.
KEPT = ("dtype", "fill_value", "preferred_chunks")
NO_FILL: dict[str, Any] = {"_FillValue": None}  # CF forbids a fill value of coordinates, and xarray's default is NaN


def prepare_for_writing(dataset: xr.Dataset) -> xr.Dataset:
    """Reduce encodings to those that any file can hold, and give `flag_values` the type that CF conventions require.

    `to_netcdf` and `to_zarr` can then write the dataset, or a part of it, in any chunks and in either format of zarr.

    Returns
    -------
    xr.Dataset
        The same dataset, changed in place.
    """
    for name, values in dataset.variables.items():
        encoding = {key: value for key, value in values.encoding.items() if key in KEPT}
        values.encoding = encoding | (NO_FILL if name in dataset.coords else {})
        if "flag_values" in values.attrs:  # zarr reads them as Python ints, but CF requires the variable's type
            values.attrs["flag_values"] = np.array(values.attrs["flag_values"], values.dtype)
    return dataset
