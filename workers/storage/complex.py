"""Store complex variables as `…_real` and `…_imag`, because few readers of zarr or NetCDF know complex numbers."""

from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

CONVENTIONS, CF = "Conventions", "CF-1.11"
REAL, IMAGINARY = "_real", "_imag"
#: Encodings of the real and imaginary part that the complex variable must not inherit: with them, writing the variable
#: would drop its imaginary part.
PARTS_ONLY = ("dtype", "fill_value")


class ComplexArray(BackendArray):
    """A complex array that is read lazily from its real and imaginary part."""

    def __init__(self, real: xr.Variable, imaginary: xr.Variable) -> None:
        self.real, self.imaginary = real, imaginary
        self.shape, self.dtype = real.shape, np.dtype(np.complex128)

    def __getitem__(self, key: indexing.ExplicitIndexer) -> Any:
        """Return the indexed values."""
        return indexing.explicit_indexing_adapter(key, self.shape, indexing.IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple[Any, ...]) -> np.ndarray:
        real = np.asarray(self.real[key])
        values = np.empty(real.shape, self.dtype)
        values.real, values.imag = (
            real,
            np.asarray(self.imaginary[key]),
        )  # real + 1j * imaginary would turn inf into NaN
        return values


def join_complex(dataset: xr.Dataset) -> xr.Dataset:
    """Replace the real and imaginary parts in a dataset by complex variables, without reading values."""
    found: dict[str, Any] = {}
    for name, values in dataset.variables.items():
        stem = str(name).removesuffix(REAL)
        if stem != name and stem + IMAGINARY in dataset.variables:
            lazy = indexing.LazilyIndexedArray(ComplexArray(values, dataset.variables[stem + IMAGINARY]))
            attributes = {
                **values.attrs,
                "long_name": str(values.attrs.get("long_name", stem)).removesuffix(", real part"),
            }
            encoding = {key: value for key, value in values.encoding.items() if key not in PARTS_ONLY}
            found[stem] = xr.Variable(values.dims, lazy, attributes, encoding)
    if not found:
        return dataset
    order = [str(name).removesuffix(REAL) for name in dataset.data_vars]
    bare = dataset.drop_vars([stem + part for stem in found for part in (REAL, IMAGINARY)])
    whole = bare.assign(found)
    whole.attrs.pop(CONVENTIONS, None)  # CF has no complex numbers, so this dataset does not follow CF any more
    return whole[[name for name in order if name in whole]]


def split_complex(dataset: xr.Dataset) -> xr.Dataset:
    """Split each complex variable of a dataset into two real variables, `…_real` and `…_imag`, as in a store.

    Files for other programs need this, because the CF conventions have no complex numbers.

    Parameters
    ----------
    dataset : xarray.Dataset
        A survey, or a part of it, as `open_survey` and `run_survey` return it.

    Returns
    -------
    xarray.Dataset
        The same numbers. `to_netcdf` writes them to a file that follows the CF conventions.

    Examples
    --------
    >>> split_complex(run_survey(...)).to_netcdf("survey.nc")  # doctest: +SKIP
    """
    if all(values.dtype.kind != "c" for values in dataset.data_vars.values()):
        return dataset
    found: dict[str, xr.Variable] = {}
    for name, values in dataset.data_vars.items():
        if values.dtype.kind != "c":
            found[str(name)] = values.variable
            continue
        for end, words, part in ((REAL, "real part", values.real), (IMAGINARY, "imaginary part", values.imag)):
            about = {**values.attrs, "long_name": f"{values.attrs.get('long_name', name)}, {words}"}
            found[f"{name}{end}"] = xr.Variable(values.dims, part.data, about)
    return xr.Dataset(found, dataset.coords, {CONVENTIONS: CF, **dataset.attrs})
