"""The survey that comes with the explorer: the plane of the paper's Figure 7, shown if there is no other survey.

`make example` computes its file.
"""

from __future__ import annotations

import xarray as xr
from zarr.storage import ZipStore

from gear_rattle.service.explorer.files import ASSETS
from gear_rattle.workers import Axis, SurveyRequest
from gear_rattle.workers.survey.values.schema import Group

EXAMPLE = ASSETS / "example.zip"

#: Groups of variables that are closed forms, and so are computed instead of stored in the file.
CLOSED_FORMS = (Group.REGION, Group.ORBITS)
#: The cells reach half a step beyond either end of the axes, so that the map is the paper's δ 0.4 … 1, ε 0 … 0.3.
REQUEST = SurveyRequest(
    delta=Axis(start=0.4015, stop=0.9985, num=200),
    epsilon=Axis(start=0.001, stop=0.299, num=150),
    quantities=(*CLOSED_FORMS, Group.ATTRACTORS, Group.LYAPUNOV, Group.INTENSITY),
)
#: Variables in the file: MAPS can be drawn as maps; KEPT also has the variables for the table of a cell's attractors.
MAPS = ("quiet_fraction", "n_attractors", "lyapunov_max", "worst_level", "chaotic_fraction", "attractor_kind")
KEPT = (*MAPS, "attractor_fraction", "attractor_m", "attractor_n_plus", "attractor_n_minus")


def load_stored_variables() -> xr.Dataset:
    """Return the variables that are stored in the example's file. Reading blocks: use a thread."""
    with ZipStore(EXAMPLE, mode="r") as store:
        return xr.open_zarr(store, consolidated=False).load()
