"""A survey of the (δ, ε) plane: its request, its tiles, its zarr store, and the dask cluster that fills it."""

from workers.bucket import Bucket
from workers.cluster import connect, embedded_cluster
from workers.errors import ClusterLostError, StorageError, SurveyError
from workers.figure import survey_figure
from workers.integrity import Integrity, examine
from workers.location import Directory, Place, place_of
from workers.maps import map_png
from workers.quantities import QUANTITIES
from workers.request import Axis, InitialConditions, SurveyRequest, TileShape
from workers.runner import run_tiles
from workers.schema import Group, Quantity
from workers.store import create_store, finish_store, open_survey, tiles_done
from workers.tiles import Tile, TileRecord, compute_tile, tiles_of

__all__ = [
    "QUANTITIES",
    "Axis",
    "Bucket",
    "ClusterLostError",
    "Directory",
    "Group",
    "InitialConditions",
    "Integrity",
    "Place",
    "Quantity",
    "StorageError",
    "SurveyError",
    "SurveyRequest",
    "Tile",
    "TileRecord",
    "TileShape",
    "compute_tile",
    "connect",
    "create_store",
    "embedded_cluster",
    "examine",
    "finish_store",
    "map_png",
    "open_survey",
    "place_of",
    "run_tiles",
    "survey_figure",
    "tiles_done",
    "tiles_of",
]
