"""Complex variables, which are stored as `…_real` and `…_imag`: few readers of zarr or NetCDF know such numbers."""

from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

REAL, IMAGINARY = "_real", "_imag"


class Both(BackendArray):
    """A complex array from its parts, read when it is asked for."""

    def __init__(self, real: xr.Variable, imaginary: xr.Variable) -> None:
        self.real, self.imaginary = real, imaginary
        self.shape, self.dtype = real.shape, np.dtype(np.complex128)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        real = np.asarray(self.real[key])
        values = np.empty(real.shape, self.dtype)
        values.real, values.imag = real, np.asarray(self.imaginary[key])  # a sum would make NaN of infinities
        return values


def joined(dataset: xr.Dataset) -> xr.Dataset:
    """Return the dataset with complex variables in the place of their parts; nothing is read."""
    found: dict[str, Any] = {}
    for name, values in dataset.variables.items():
        stem = str(name).removesuffix(REAL)
        if stem != name and stem + IMAGINARY in dataset.variables:
            lazy = indexing.LazilyIndexedArray(Both(values, dataset.variables[stem + IMAGINARY]))
            attributes = {
                **values.attrs,
                "long_name": str(values.attrs.get("long_name", stem)).removesuffix(", real part"),
            }
            found[stem] = xr.Variable(values.dims, lazy, attributes, values.encoding)
    if not found:
        return dataset
    order = [str(name).removesuffix(REAL) for name in dataset.data_vars]
    bare = dataset.drop_vars([stem + part for stem in found for part in (REAL, IMAGINARY)])
    whole = bare.assign(found)
    return whole[[name for name in order if name in whole]]
