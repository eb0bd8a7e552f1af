"""Run tiles on dask: submit them, repeat lost ones, isolate tiles that kill workers, and compute windows.

`dask worker --preload gear_rattle.cluster` makes a worker import everything it needs before it must send heartbeats.
"""

from importlib import import_module


def dask_setup(_worker: object) -> None:
    """Import the modules that compute tiles. dask calls this in a worker before the worker reports to its scheduler."""
    import_module("gear_rattle.workers.cluster.runner")
