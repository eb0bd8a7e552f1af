"""A survey of the (δ, ε) plane, or a population of gears: its request, its tiles, its zarr store, and the dask cluster
that fills it.

Pictures are apart, in `workers.pictures.figure` and `workers.pictures.maps`: processes that compute need not load what
draws.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from workers.cluster.window import Frame, compute_part, map_quantity, window_survey
from workers.completion import complete, is_incomplete
from workers.errors import ClusterLostError, StoppedError, StorageError, SurveyError
from workers.families.join import join_survey, lacks_families
from workers.families.one import open_family
from workers.in_process import compile_for, is_short, run_tiles_here
from workers.kinds import AnyRequest, compute_tile, request_of, tiles_of
from workers.populations.request import PopulationRequest
from workers.run import run_survey
from workers.storage.bucket import Bucket
from workers.storage.integrity import Integrity, examine
from workers.storage.location import Directory, Place, place_of
from workers.storage.store import create_store, finish_store, open_survey, tiles_done
from workers.survey.axes import Axis, Window
from workers.survey.request import InitialConditions, SurveyRequest, TileShape
from workers.survey.tiles import Tile, TileRecord
from workers.survey.values.quantities import QUANTITIES
from workers.survey.values.schema import Group, Quantity

if TYPE_CHECKING:
    from workers.cluster.cluster import connect, embedded_cluster
    from workers.cluster.costs import Begun
    from workers.cluster.refinement import refined
    from workers.cluster.runner import complete_on, run_tiles, template_on

#: What needs dask's cluster, a quarter of a second that a survey in one process does not wait for.
_ON_CLUSTERS = {
    "Begun": "workers.cluster.costs",
    "complete_on": "workers.cluster.runner",
    "connect": "workers.cluster.cluster",
    "embedded_cluster": "workers.cluster.cluster",
    "refined": "workers.cluster.refinement",
    "run_tiles": "workers.cluster.runner",
    "template_on": "workers.cluster.runner",
}

__all__ = [
    "QUANTITIES",
    "AnyRequest",
    "Axis",
    "Begun",
    "Bucket",
    "ClusterLostError",
    "Directory",
    "Frame",
    "Group",
    "InitialConditions",
    "Integrity",
    "Place",
    "PopulationRequest",
    "Quantity",
    "StoppedError",
    "StorageError",
    "SurveyError",
    "SurveyRequest",
    "Tile",
    "TileRecord",
    "TileShape",
    "Window",
    "compile_for",
    "complete",
    "complete_on",
    "compute_part",
    "compute_tile",
    "connect",
    "create_store",
    "embedded_cluster",
    "examine",
    "finish_store",
    "is_incomplete",
    "is_short",
    "join_survey",
    "lacks_families",
    "map_quantity",
    "open_family",
    "open_survey",
    "place_of",
    "refined",
    "request_of",
    "run_survey",
    "run_tiles",
    "run_tiles_here",
    "template_on",
    "tiles_done",
    "tiles_of",
    "window_survey",
]


def __getattr__(name: str) -> Any:
    if name not in _ON_CLUSTERS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_ON_CLUSTERS[name]), name)
