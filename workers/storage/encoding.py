"""Set the encoding of an opened dataset, so that xarray can write it to other files."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

#: Chunks and codecs are left out: they belong to the store that was read, and would be errors in another file.
KEPT = ("dtype", "fill_value", "preferred_chunks")
NO_FILL: dict[str, Any] = {"_FillValue": None}  # CF allows no fill value of coordinates; xarray's default is NaN


def prepare_for_writing(dataset: xr.Dataset) -> xr.Dataset:
    """Return the dataset with encodings and flags that any file can hold and that keep the CF conventions.

    `to_netcdf` and `to_zarr` can then write it, or a part of it, in any chunks and in either format of zarr.

    Returns
    -------
    xr.Dataset
        The same dataset, changed in place.
    """
    for name, values in dataset.variables.items():
        encoding = {key: value for key, value in values.encoding.items() if key in KEPT}
        values.encoding = encoding | (NO_FILL if name in dataset.coords else {})
        if "flag_values" in values.attrs:  # JSON has no types, but CF requires the variable's type
            values.attrs["flag_values"] = np.array(values.attrs["flag_values"], values.dtype)
    return dataset
