"""Run tiles on dask: submit, repeat, isolate, refine.

`dask worker --preload gear_rattle.cluster` imports the modules of tiles before a worker must send heartbeats.
"""

from importlib import import_module


def dask_setup(_worker: object) -> None:
    """Set up a worker that preloads the module, before it reports to its scheduler; dask calls this."""
    import_module("gear_rattle.workers.cluster.runner")
