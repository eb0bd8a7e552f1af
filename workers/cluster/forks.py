"""The process that workers on this machine are forked from: it has loaded what they need, and they share its memory.

A worker that starts by itself loads modules and kernels for a second and a half of a processor; one that is forked is
there at once, also in the place of one that was killed. The process is multiprocessing's fork server: the first cluster
starts it, the next ones find it there, and it ends with ours. Where Python has none, or that of macOS, whose libraries
do not bear a fork, or its socket would have too long a name, workers start by themselves.
"""

import os
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import Future, wait
from multiprocessing import get_context, set_forkserver_preload
from threading import Thread

import dask
import distributed.utils

from workers.errors import SurveyError

METHOD = "forkserver" if sys.platform == "linux" else "spawn"
LOOK_SECONDS = 0.1  # between two questions whether it shall still be waited for
LOADED = "gear_rattle.loaded"
LONGEST_NAME = 107  # bytes of a socket's, on Linux
NAMED = len("/pymp-12345678/listener-12345678")  # below the directory of temporary files, the fork server's


def method() -> str:
    """How workers start, as multiprocessing calls it: by a fork server if there is one, and its socket has a name."""
    fits = len(os.fsencode(tempfile.gettempdir())) + NAMED <= LONGEST_NAME
    return METHOD if fits else "spawn"


def prepare(should_stop: Callable[[], bool]) -> None:
    """Return when workers can be forked: after seconds, if what they need has not been loaded yet.

    Args:
        should_stop: asked several times a second whether that shall not be waited for any more.

    Raises:
        SurveyError: it shall not.
    """
    if method() != "forkserver":
        return
    distributed.utils._forkserver_preload_set = True  # dask would have it load other things, and load them here too
    set_forkserver_preload([LOADED])
    # As dask does before each process that it starts: how many threads libraries have is decided as they are loaded.
    os.environ.update(
        {name: str(value) for name, value in dask.config.get("distributed.nanny.pre-spawn-environ").items()}
    )
    first = Future[None]()
    Thread(target=_fork, args=(first,), name="fork-server", daemon=True).start()
    while not wait([first], LOOK_SECONDS).done:
        if should_stop():
            raise SurveyError("it shall not any more")
    first.result()


def _fork(first: Future[None]) -> None:
    try:
        process = get_context("forkserver").Process(target=int, daemon=True)
        process.start()
        process.join()
    except Exception as error:
        first.set_exception(error)
    else:
        first.set_result(None)
