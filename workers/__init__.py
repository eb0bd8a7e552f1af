"""Surveys of the (δ, ε) plane and populations of gears: request, tiles, zarr store, and the dask cluster.

This module does not import workers/pictures, so that processes that compute do not load matplotlib.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gear_rattle.workers.cluster.window import WindowFrame, compute_window_part, quantity_of_map, request_for_window
from gear_rattle.workers.completion import complete, is_incomplete
from gear_rattle.workers.errors import ClusterLostError, StoppedError, StorageError, SurveyError
from gear_rattle.workers.families.join import join_attractors_of_survey, lacks_families
from gear_rattle.workers.families.one import open_family
from gear_rattle.workers.in_process import run_tiles_in_this_process, takes_few_seconds
from gear_rattle.workers.kinds import (
    AnyRequest,
    compile_kernels_for_request,
    compute_tile,
    parse_request_document,
    tiles_of,
)
from gear_rattle.workers.populations.request import PopulationRequest
from gear_rattle.workers.run import run_survey
from gear_rattle.workers.storage.bucket import StoreInBucket
from gear_rattle.workers.storage.integrity import StoreIntegrity, examine
from gear_rattle.workers.storage.location import Place, StoreDirectory, place_of
from gear_rattle.workers.storage.store import create_store, finish_store, open_survey, tiles_done
from gear_rattle.workers.survey.axes import Axis, Window
from gear_rattle.workers.survey.request import InitialConditions, SurveyRequest, TileShape
from gear_rattle.workers.survey.tiles import Tile, TileRecord
from gear_rattle.workers.survey.values.quantities import QUANTITIES
from gear_rattle.workers.survey.values.schema import Group, Quantity

if TYPE_CHECKING:
    from gear_rattle.workers.cluster.cluster import connect, embedded_cluster
    from gear_rattle.workers.cluster.costs import RunState
    from gear_rattle.workers.cluster.refinement import refined_frames
    from gear_rattle.workers.cluster.runner import complete_on_cluster, compute_template_on_cluster, run_tiles

#: {name: module from which it is imported at its first use}. These modules import dask's `distributed`, which takes a
#: quarter of a second and is not needed by a survey in one process.
_ON_CLUSTERS = {
    "RunState": "gear_rattle.workers.cluster.costs",
    "complete_on_cluster": "gear_rattle.workers.cluster.runner",
    "connect": "gear_rattle.workers.cluster.cluster",
    "embedded_cluster": "gear_rattle.workers.cluster.cluster",
    "refined_frames": "gear_rattle.workers.cluster.refinement",
    "run_tiles": "gear_rattle.workers.cluster.runner",
    "compute_template_on_cluster": "gear_rattle.workers.cluster.runner",
}

__all__ = [
    "QUANTITIES",
    "AnyRequest",
    "Axis",
    "ClusterLostError",
    "Group",
    "InitialConditions",
    "Place",
    "PopulationRequest",
    "Quantity",
    "RunState",
    "StoppedError",
    "StorageError",
    "StoreDirectory",
    "StoreInBucket",
    "StoreIntegrity",
    "SurveyError",
    "SurveyRequest",
    "Tile",
    "TileRecord",
    "TileShape",
    "Window",
    "WindowFrame",
    "compile_kernels_for_request",
    "complete",
    "complete_on_cluster",
    "compute_template_on_cluster",
    "compute_tile",
    "compute_window_part",
    "connect",
    "create_store",
    "embedded_cluster",
    "examine",
    "finish_store",
    "is_incomplete",
    "join_attractors_of_survey",
    "lacks_families",
    "open_family",
    "open_survey",
    "parse_request_document",
    "place_of",
    "quantity_of_map",
    "refined_frames",
    "request_for_window",
    "run_survey",
    "run_tiles",
    "run_tiles_in_this_process",
    "takes_few_seconds",
    "tiles_done",
    "tiles_of",
]


def __getattr__(name: str) -> Any:
    if name not in _ON_CLUSTERS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_ON_CLUSTERS[name]), name)
