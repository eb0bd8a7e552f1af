"""dask: submit, repeat, isolate, refine.

`dask worker --preload gear_rattle.cluster` imports what tiles need before the worker's heart has to beat.
"""

from importlib import import_module


def dask_setup(_worker: object) -> None:
    """Called by dask for a preloaded module, before a worker reports to its scheduler."""
    import_module("gear_rattle.workers.cluster.runner")
