"""Module that a worker of your own cluster loads before it reports: ``dask worker … --preload gear_rattle.cluster``."""

from gear_rattle.workers.cluster import dask_setup

__all__ = ["dask_setup"]
