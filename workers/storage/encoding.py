"""The encoding of a dataset that was opened from a store: what xarray is to do when it is written to another file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr

#: Chunks and codecs belong to the store that was read: of another file they would be errors.
KEPT = ("dtype", "fill_value", "preferred_chunks")
NO_FILL: dict[str, Any] = {"_FillValue": None}  # CF allows none for coordinates; xarray writes NaN unless told


def prepare_for_writing(dataset: xr.Dataset) -> xr.Dataset:
    """Return the dataset with encodings and flags that any file can hold and that keep the CF conventions.

    `to_netcdf` and `to_zarr` write it then as it is, or a part of it, in any chunks and in either format of zarr.

    Returns
    -------
    xr.Dataset
        The data set.
    """
    for name, values in dataset.variables.items():
        encoding = {key: value for key, value in values.encoding.items() if key in KEPT}
        values.encoding = encoding | (NO_FILL if name in dataset.coords else {})
        if "flag_values" in values.attrs:  # JSON knows no types, CF asks for the variable's own
            values.attrs["flag_values"] = np.array(values.attrs["flag_values"], values.dtype)
    return dataset
