"""The module that workers of your own cluster preload: ``dask worker … --preload gear_rattle.cluster``."""

from gear_rattle.workers.cluster import dask_setup

__all__ = ["dask_setup"]
