"""The scheduler and the workers of a cluster of our own: they listen to each other only, and slow is not frozen."""

import math
import time
from typing import Any

import psutil
from distributed import Scheduler, Worker


class NoPages:
    """A part of a cluster without dask's HTTP server, whose pages nobody reads and every local account could."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Open no port."""


class SilentWorker(NoPages, Worker):
    """A worker that listens for certificates of its cluster only."""


class SilentScheduler(NoPages, Scheduler):
    """A scheduler that listens for certificates of its cluster only, whose workers are on this machine."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._looked = dict[int, tuple[float, float, float]]()

    async def check_worker_ttl(self) -> None:
        """End silent workers, but none that gets on: on a busy machine a word takes as long as all else.

        One that uses as many seconds of a processor without a word as it may be silent does not get on either.
        """
        for worker in self.workers.values():
            used = processor_seconds(worker.pid)
            heard, at_word, before = self._looked.get(worker.pid, (math.nan, used, -1.0))
            if worker.last_seen != heard:
                at_word = used
            if before < used < at_word + (self.worker_ttl or math.inf):
                worker.last_seen = time.time()
            self._looked[worker.pid] = worker.last_seen, at_word, used
        await super().check_worker_ttl()


def processor_seconds(pid: int) -> float:
    """What a process of this machine has used of the processors; nothing if it is gone."""
    try:
        times = psutil.Process(pid).cpu_times()
    except psutil.Error:
        return 0.0
    return float(times.user + times.system)
