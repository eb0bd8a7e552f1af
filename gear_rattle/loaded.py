"""What workers on this machine begin with, loaded once by the process that they are forked from: see
`workers.cluster.forks`, which names this module. Here, because it is loaded before anything else is.
"""

import gc
import os
import signal
from contextlib import suppress
from functools import partial

LOOK_SECONDS = 0.1


def _load() -> None:
    from rattle.warm import is_compiled, warm_up
    from workers.cluster import cluster, runner  # noqa: F401 - what is forked uses them

    if is_compiled():  # or the workers divide the work
        warm_up()


def _end_unless_child_of(parent: int, *_: object) -> None:
    if os.getppid() != parent:
        signal.setitimer(signal.ITIMER_REAL, 0)  # or what `coverage` writes at the end is interrupted for ever
        os._exit(1)


_before = signal.signal(signal.SIGALRM, partial(_end_unless_child_of, os.getppid()))
signal.setitimer(signal.ITIMER_REAL, LOOK_SECONDS, LOOK_SECONDS)  # nobody waits for what is loaded for nobody
gc.disable()  # nothing of it is ever garbage
with suppress(Exception):  # the workers say it
    _load()
gc.freeze()  # what is looked through is copied: it shall stay shared
gc.enable()
signal.setitimer(signal.ITIMER_REAL, 0)
signal.signal(signal.SIGALRM, _before)
