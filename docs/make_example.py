"""Make the survey that the explorer shows where there is none: `make example`.

It covers the plane of the paper's Figure 7 as `gear_rattle.service.explorer.places.example` describes it. Of its
variables those are kept that this module names, with as many digits as a map or a table of a cell shows, in a zip file
that comes with the wheel.
"""

import shutil
import tempfile
from pathlib import Path

import numpy as np
import xarray as xr

from gear_rattle.service.explorer.places.example import EXAMPLE, KEPT, REQUEST
from gear_rattle.workers import run_survey

DIGITS = {"lyapunov_max": 3, "worst_level": 2}
LARGEST = 300_000  # bytes


def reduced(survey: xr.Dataset) -> xr.Dataset:
    """Return what is kept of a survey."""
    kept = survey[list(KEPT)].reset_coords(drop=True).drop_attrs(deep=False).assign_attrs(request=survey.request)
    return kept.assign({name: kept[name].round(digits).astype(np.float32) for name, digits in DIGITS.items()})


def write(example: xr.Dataset) -> None:
    """Write it as a zipped zarr store, each variable in one chunk."""
    encoding = {name: {"chunks": values.shape} for name, values in example.variables.items()}
    with tempfile.TemporaryDirectory() as directory:
        example.drop_encoding().to_zarr(directory, encoding=encoding, consolidated=False, zarr_format=3)
        shutil.make_archive(str(EXAMPLE.with_suffix("")), "zip", directory)
    assert EXAMPLE.stat().st_size < LARGEST, EXAMPLE.stat().st_size


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as directory:
        write(reduced(run_survey(REQUEST, out=Path(directory, "survey.zarr"))).load())
