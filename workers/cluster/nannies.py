"""The process that starts the workers of a cluster on this machine. Each worker has a nanny of dask, which restarts it.

A worker that multiprocessing starts imports the main module of the process that starts it. Here that main module is
this file. So a user's script needs no ``if __name__ == "__main__"``, and workers never run it.
"""

import asyncio
import gc
import os
import pickle
import signal
import sys
import threading
from contextlib import suppress
from typing import Any, NamedTuple

COLLECTION_THRESHOLD = 400_000  # number of new objects between two garbage collections; Python's default is 700

# With Python's default threshold, garbage collections during the imports took a fifth of a worker's start-up time. The
# threshold is set here because a worker imports this module before anything else.
gc.set_threshold(COLLECTION_THRESHOLD)

#: Module of the process with which Python removes the semaphores of dead processes.
TRACKER = "multiprocessing.resource_tracker"


class StartMessage(NamedTuple):
    """The message that the process of the nannies reads from stdin when it starts.

    config: dask's settings. scheduler: address of the scheduler. n_workers: number of workers to start. nice: how far
    to lower the priority of all processes. options: options of each worker's nanny.
    """

    config: dict[str, Any]
    scheduler: str
    n_workers: int
    nice: int
    options: dict[str, Any]


def main() -> None:
    """Run nannies and workers until all workers have closed, or the process that wrote to stdin has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends neither this process nor the workers, which inherit this
    import dask
    import distributed  # noqa: F401 - loaded while the caller's scheduler starts

    start: StartMessage = pickle.load(sys.stdin.buffer)
    threading.Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()
    os.setpriority(os.PRIO_PROCESS, 0, max(start.nice, os.getpriority(os.PRIO_PROCESS, 0)))
    dask.config.update(dask.config.config, start.config)
    asyncio.run(_run_nannies(start))


async def _run_nannies(start: StartMessage) -> None:
    from distributed import Nanny

    nannies = [Nanny(start.scheduler, **start.options) for _ in range(start.n_workers)]
    await asyncio.gather(*nannies)
    await asyncio.gather(*(nanny.finished() for nanny in nannies))


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    end_process_tree(os.getpid())


def end_process_tree(pid: int) -> None:
    """Kill a process and all its descendants, frozen ones too. Python's resource tracker is spared; it ends itself."""
    import psutil

    with suppress(psutil.NoSuchProcess):
        process = psutil.Process(pid)
        children = process.children(recursive=True)
        if pid != os.getpid():
            process.kill()  # before its children, because nannies restart killed workers
        for child in children:
            with suppress(psutil.Error):
                if TRACKER not in " ".join(child.cmdline()):
                    child.kill()
    if pid == os.getpid():
        os._exit(1)


if __name__ == "__main__":
    main()
