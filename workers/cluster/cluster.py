"""The dask cluster that computes tiles: start one on this machine, or connect to an existing one."""

import asyncio
import gc
import json
import logging
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import Any

import dask
from distributed import Client, Future, Scheduler, Security, SpecCluster, Status, Worker, WorkerPlugin, comm
from distributed.scheduler import DEFAULT_EXTENSIONS
from distributed.utils import silence_logging_cmgr

import rattle
from gear_rattle.workers.cluster import nannies
from gear_rattle.workers.cluster.scratch import scratch_directory
from gear_rattle.workers.errors import ClusterLostError, SurveyError
from rattle.numerics import child_process_environment

MEMORY_LIMIT = 2 * 2**30
CONNECT_SECONDS = 10
#: Each worker computes with one thread. Several workers compute tiles in parallel, and more threads would only compete.
ONE_THREAD = {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


#: dask replaces a worker that has sent no heartbeat for this many seconds; dask notices it within twice this time. In a
#: small cluster every worker sends two heartbeats a second. The time is long, so that dask keeps slow workers.
SILENT_SECONDS = 60
#: After two deaths of its worker, a tile is computed in a process of its own, which shows which cells are the cause.
ALLOWED_DEATHS = 1
HEARTBEAT_SECONDS = 1.0  # seconds between two heartbeats of a worker that loads kernels
WATCH_SECONDS = 0.1  # seconds between two checks whether the nannies' process lives and whether start-up was cancelled
#: END_SECONDS: longest wait for killed workers to vanish, or for workers to say whether they compute a task.
#: LOOK_SECONDS: seconds between two checks during such waits, and while workers start.
END_SECONDS, LOOK_SECONDS = 1.0, 0.02
#: Cancelled tasks have ended if no worker runs one in this many successive checks: by then all messages have arrived.
IDLE_CHECKS = 5
FEW_RECORDS = 10  # number of messages, of loads and of computations that dask keeps
#: Settings that make dask keep fewer diagnostics than by default (1000 messages of every connection, two hours of each
#: processor's load, all submitted tasks), because nobody reads them here. By default dask also measures load and clock
#: so often that two idle workers took a seventh of a processor for it.
FEW_DIAGNOSTICS = {
    "distributed.admin.low-level-log-length": FEW_RECORDS,
    "distributed.admin.system-monitor.log-length": FEW_RECORDS,
    "distributed.admin.system-monitor.interval": "60s",
    "distributed.admin.tick.interval": "1s",
    "distributed.diagnostics.computations.max-history": FEW_RECORDS,
    "distributed.worker.profile.enabled": False,
}
#: Settings that leave dask's HTTP servers without pages, because every local account can reach these servers.
NO_PAGES: dict[str, list[str]] = {"distributed.scheduler.http.routes": [], "distributed.worker.http.routes": []}
SPANS = "spans"  # an extension of dask that is left out, because it keeps records in the scheduler for ever

OURS, MODULE = "gear-rattle", "gear_rattle"
#: Packages whose versions must be equal in all processes. Processes with different versions cannot exchange messages,
#: or they compute different bits.
PACKAGES = (OURS, "dask", "distributed", "numpy", "numba", "llvmlite", "zarr")
WORKERS_IN_MESSAGE = 3  # a message names at most this many workers
REFUSED_TOPIC = "gear-rattle-refused"  # topic of dask's events about workers that are refused because of other software

logger = logging.getLogger(__name__)


class KernelLoader(WorkerPlugin):
    """A plugin that loads the kernels on each worker before its first tile, also on a restarted worker."""

    name = "gear-rattle-kernels"

    async def setup(self, worker: Worker) -> None:
        """Load the kernels in a thread, and send heartbeats meanwhile: compiling takes longer than dask waits."""
        warming = asyncio.create_task(asyncio.to_thread(rattle.precompile, preload=True))
        while not (await asyncio.wait([warming], timeout=HEARTBEAT_SECONDS))[0]:
            await worker.heartbeat()
        await warming

    def teardown(self, worker: Worker) -> None:  # noqa: ARG002 - dask's signature
        """Exempt all objects from garbage collection; a collection would delay the worker's end by 1/3 second."""
        gc.freeze()


def create_version_check(versions: Mapping[str, str | None], module: str, topic: str) -> WorkerPlugin:
    """Return a plugin that closes a worker before its first task if the worker's software differs from `versions`.

    In all other workers the plugin loads the kernels.

    The check holds for workers that join later, too. The plugin's class is defined inside this function, because dask
    then sends all of its code, which even a worker without this package can run. So the class imports this
    module only after the check.

    Parameters
    ----------
    versions : Mapping[str, str | None]
        Required versions by package; the version of Python is its first two numbers.
    module : str
        Name of this module, which a worker must be able to import.
    topic : str
        Topic of dask's events in which a refused worker is named.

    Returns
    -------
    WorkerPlugin
        The plugin, for `Client.register_plugin`.
    """

    class VersionCheck(WorkerPlugin):
        name = "gear-rattle-versions"

        async def setup(self, worker: Worker) -> None:
            """Close the worker before its first task if its software differs; otherwise load the kernels."""
            import asyncio
            import platform
            from contextlib import suppress
            from importlib import import_module, metadata
            from importlib.util import find_spec

            package = module.partition(".")[0]
            here: dict[str, str | None] = {"Python": ".".join(platform.python_version_tuple()[:2])}
            for name in versions.keys() - here.keys():
                with suppress(metadata.PackageNotFoundError):
                    here[name] = metadata.version(name)
            differing = [name for name, version in versions.items() if here.get(name) != version]
            found = f"has {differing[0]} {here.get(differing[0]) or 'none'}" if differing else ""
            if find_spec(package) is None:
                differing, found = [next(iter(versions))], f"cannot import {package}"
            if differing:
                required = f"{differing[0]} {versions[differing[0]] or 'none'}"
                sentence = (
                    f"the worker at {worker.address} {found}, and the process that runs surveys has {required}: "
                    "the worker is refused, install the same version on both"
                )
                worker.log_event(topic, sentence)
                # Do not wait here until the worker has closed. Closing needs an answer of the nanny, so that the nanny
                # does not restart the worker, and the nanny answers only once the worker has started.
                self.closing = asyncio.create_task(worker.close(reason=sentence))
                await asyncio.sleep(0)  # lets the task above begin to close the worker
                raise RuntimeError(sentence)  # dask writes this error to the worker's log
            await import_module(module).KernelLoader().setup(worker)

    return VersionCheck()


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """Make threads and processes that start in this context ignore Ctrl-C, which a terminal sends to all of them.

    A Ctrl-C during the context reaches the caller afterwards.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _WorkerProcesses:
    """Keep a process running that starts the nannies and workers. If it ends after start-up, start another process.

    Parameters
    ----------
    nice
        How far to lower the priority of the processes.
    should_stop
        Returns whether start-up was cancelled. It is called several times a second until `started` is set.
    """

    def __init__(self, n_workers: int, nice: int, cluster: SpecCluster, should_stop: Callable[[], bool]) -> None:
        options: dict[str, Any] = {
            "host": "127.0.0.1",
            "security": cluster.security,
            "nthreads": 1,
            "memory_limit": MEMORY_LIMIT,
            "dashboard": False,
            "silence_logs": logging.CRITICAL,
            "extensions": {},  # dask's only extension of workers is SPANS, which is left out
            "preload": __name__,  # a worker imports this module before it must send heartbeats
        }
        start = nannies.StartMessage(dask.config.config, cluster.scheduler_address, n_workers, nice, options)
        self._start, self._n_workers, self._should_stop = pickle.dumps(start), n_workers, should_stop
        self._cluster = cluster
        self.started, self._over = Event(), Event()
        self._thread = Thread(target=self._keep_nanny_process_running, name="keep-workers", daemon=True)

    def __enter__(self) -> "_WorkerProcesses":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def wait_for_workers(self, client: Client) -> None:
        """Wait until all workers have connected.

        Raises
        ------
        SurveyError
            The workers cannot start, or start-up was cancelled.
        """
        while len(client.nthreads()) < self._n_workers:
            if self._over.wait(LOOK_SECONDS):
                raise SurveyError(
                    "start-up was cancelled" if self._should_stop() else "the process that starts the workers has ended"
                )

    def _keep_nanny_process_running(self) -> None:
        while not self._over.is_set():
            self._run_nanny_process()
            if not self.started.is_set() or self._cluster.status != Status.running:
                self._over.set()
            self._over.wait(WATCH_SECONDS)

    def _run_nanny_process(self) -> None:
        """Start the process of the nannies, wait until it ends or `_over` is set, then kill it and its descendants."""
        command = [sys.executable, "-m", nannies.__name__]
        # The process has a session of its own, so a terminal's Ctrl-C does not reach it. It ends when its stdin closes.
        with subprocess.Popen(command, stdin=subprocess.PIPE, env=_environment(), start_new_session=True) as process:
            assert process.stdin is not None
            try:
                with suppress(BrokenPipeError):
                    process.stdin.write(self._start)
                    process.stdin.flush()
                while process.poll() is None and not self._over.wait(WATCH_SECONDS):
                    if not self.started.is_set() and self._should_stop():
                        # Without this, the log would list every asyncio task that the cancelled start-up leaves behind.
                        logging.getLogger("asyncio").setLevel(logging.CRITICAL)
                        self._over.set()
            finally:
                nannies.end_process_tree(process.pid)


def _environment() -> dict[str, str]:
    """Return this process's environment variables, changed for workers: one thread each, no semaphore warnings."""
    ignored = ",".join(filter(None, [os.environ.get("PYTHONWARNINGS"), "ignore:resource_tracker:UserWarning"]))
    return {**child_process_environment(), **ONE_THREAD, "PYTHONWARNINGS": ignored}


@contextmanager
def embedded_cluster(
    n_workers: int = 2, nice: int = 0, should_stop: Callable[[], bool] = lambda: False
) -> Iterator[Client]:
    """Start processes of one thread each on this machine, for as long as the context lasts.

    The processes listen on loopback only, and accept each other only: every connection shows the certificate of this
    cluster, whose key is in the memory of its processes. They import nothing from the working directory, nor the main
    module.

    Parameters
    ----------
    n_workers : int
        Number of processes.
    nice : int
        How far to lower their priority, up to 19.
    should_stop : Callable[[], bool]
        Returns whether start-up was cancelled. It is called several times a second while the processes start.

    Yields
    ------
    Client
        A client of the cluster.

    Raises
    ------
    SurveyError
        `n_workers` is below 1, the processes do not start, or start-up was cancelled.
    """
    if n_workers < 1:
        raise SurveyError(f"n_workers must be at least 1, got {n_workers}")
    with ExitStack() as stack:
        # The cluster's event loop logs every lost connection with a traceback until the loop ends. dask's own option
        # `silence_logs` does not silence the last tracebacks, because dask resets the option before the loop ends.
        stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
        # Workers run in this directory, where Python first looks for modules; dask's default is open to all accounts.
        scratch = stack.enter_context(scratch_directory(dask.config.get("temporary-directory", None)))
        stack.enter_context(dask.config.set({**FEW_DIAGNOSTICS, **NO_PAGES, "temporary-directory": scratch}))
        try:
            with _block_interrupts():
                cluster = stack.enter_context(_cluster_without_workers())
                processes = stack.enter_context(_WorkerProcesses(n_workers, nice, cluster, should_stop))
                client = stack.enter_context(Client(cluster, set_as_default=False))
            processes.wait_for_workers(client)
            client.register_plugin(KernelLoader())
        except Exception as error:
            raise SurveyError(f"the embedded cluster of {n_workers} processes does not start: {error}") from error
        processes.started.set()
        yield client


def _cluster_without_workers() -> SpecCluster:
    part = {"host": "127.0.0.1", "protocol": "tls://", "security": Security.temporary()}
    options = {
        **part,
        "dashboard": False,
        "dashboard_address": "127.0.0.1:0",
        "worker_ttl": SILENT_SECONDS,
        "allowed_failures": ALLOWED_DEATHS,
        "extensions": {name: each for name, each in DEFAULT_EXTENSIONS.items() if name != SPANS},
    }
    return SpecCluster(scheduler={"cls": Scheduler, "options": options}, security=part["security"])


@contextmanager
def connect(url: str) -> Iterator[Client]:
    """Connect to an existing dask scheduler, for example at `tcp://host:8786`. The scheduler keeps running afterwards.

    The scheduler's workers need the same version of this package, and access to the store under the same path. A worker
    that joins later with other software is closed before it computes, and the logs of both processes say why. For an
    address `tls://host:8786`, dask's settings `distributed.comm.tls` name the certificates.

    Parameters
    ----------
    url : str
        Address of the scheduler, or path of a scheduler file (`dask scheduler --scheduler-file PATH.json`). The file is
        read again at each call, because a batch system may start the next scheduler on another host.

    Yields
    ------
    Client
        A client of the scheduler.

    Raises
    ------
    ClusterLostError
        Nothing answers at the address, or it has no workers, or the scheduler file cannot be read.
    SurveyError
        The workers cannot be prepared, or have other versions.
    """
    url = _scheduler_address(url)
    with ExitStack() as stack:
        # The client would log every lost connection with a traceback; the exception below reports it in one sentence.
        stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
        try:
            _require_answer(url)
            client = stack.enter_context(Client(url, timeout=CONNECT_SECONDS, set_as_default=False))
            client.wait_for_workers(1, timeout=CONNECT_SECONDS)
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            # Wrong settings of TLS raise TypeError or RuntimeError.
            raise ClusterLostError(
                f"no dask scheduler with workers answers at {url} ({error}): start both, or correct the address or the "
                "settings of TLS"
            ) from error
        try:
            versions = require_compatible_workers(client)
            client.subscribe_topic(REFUSED_TOPIC, lambda event: logger.warning("%s", event[1]))
            client.register_plugin(create_version_check(versions, __name__, REFUSED_TOPIC))
        except SurveyError:
            raise
        except Exception as error:
            raise SurveyError(f"the workers at {url} cannot be prepared ({error}): see their logs") from error
        yield client


def require_compatible_workers(client: Client) -> dict[str, str | None]:
    """Require that all workers have the same versions of Python and packages as this process.

    Returns
    -------
    dict[str, str | None]
        Versions of this process by package.

    Raises
    ------
    SurveyError
        A worker lacks this package, or has another version of it, of Python or of a library. The message names both
        versions.
    """
    found = client.run(find_spec, MODULE, on_error="return")
    if without := [address for address, spec in found.items() if not isinstance(spec, ModuleSpec)]:
        raise SurveyError(
            f"{_workers_in_words(without)} cannot import {MODULE}: install {OURS} on these workers, in the version of "
            f"this process: pip install '{OURS}[workers]=={_own_version(client)}' (and [s3] for stores in a bucket)"
        )
    versions: Any = client.get_versions(packages=list(PACKAGES))
    here = _versions_by_package(versions["client"])
    others = {address: _versions_by_package(each) for address, each in versions["workers"].items()}
    for name, version in here.items():
        differing = {address: each[name] for address, each in others.items() if each[name] != version}
        if differing:
            theirs = ", ".join(sorted({each or "none" for each in differing.values()}))
            raise SurveyError(
                f"{_workers_in_words(list(differing))} has {name} {theirs}, and this process has {name} "
                f"{version or 'none'}: install the same version on both"
            )
    return here


def _own_version(client: Client) -> str:
    versions: Any = client.get_versions(packages=[OURS])
    return str(versions["client"]["packages"][OURS] or "VERSION")


def _versions_by_package(versions: Mapping[str, Any]) -> dict[str, str | None]:
    """Return versions by package; the version of Python is its first two numbers."""
    packages = {name: versions["packages"].get(name) for name in PACKAGES}
    return packages | {"Python": ".".join(str(versions["host"]["python"]).split(".")[:2])}


def _workers_in_words(addresses: list[str]) -> str:
    more = f" and {len(addresses) - WORKERS_IN_MESSAGE} more" if len(addresses) > WORKERS_IN_MESSAGE else ""
    return (
        ("the worker at " if len(addresses) == 1 else "workers at ")
        + ", ".join(sorted(addresses)[:WORKERS_IN_MESSAGE])
        + more
    )


def _scheduler_address(url: str) -> str:
    """Return a scheduler's address, given this address or the path of its scheduler file. Raises ClusterLostError."""
    if not url.endswith(".json"):
        return url
    try:
        return str(json.loads(Path(url).read_text())["address"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ClusterLostError(
            f"the dask scheduler file {url} cannot be read ({error}): start a scheduler that writes this file, or "
            "correct the path"
        ) from error


def kill_workers(client: Client, addresses: list[str]) -> None:
    """Kill workers, even during a task, and wait until they are gone, but at most END_SECONDS.

    Workers without a nanny are spared, because nothing restarts them.
    """
    if addresses:
        # A frozen worker does not answer this call, so a thread makes the call and nothing waits for the answer.
        ending = partial(client.run, _end_process, workers=addresses, wait=False, on_error="ignore")
        thread = Thread(target=ending, name="end-processes", daemon=True)
        thread.start()
        # Wait until the workers are gone, because until then dask may send tasks to them.
        deadline = time.monotonic() + END_SECONDS
        with suppress(OSError):
            while time.monotonic() < deadline and not client.nthreads().keys().isdisjoint(addresses):
                time.sleep(LOOK_SECONDS)


def end_tasks(client: Client, futures: list[Future]) -> None:
    """Cancel tasks, and kill the workers that run only these tasks and have a nanny."""
    keys = {future.key for future in futures}
    try:
        processing = client.processing()
        client.cancel(futures)  # otherwise dask would repeat the tasks of killed workers on other workers
    except OSError:  # the scheduler is gone
        return
    kill_workers(client, [address for address, busy in processing.items() if busy and keys.issuperset(busy)])


def end_tasks_and_wait(client: Client, futures: list[Future]) -> None:
    """Cancel tasks, and return when no process computes any of them.

    A worker may have begun a task just when it was cancelled, and then the scheduler does not know that the task runs.
    Workers with a nanny are killed; a worker without a nanny completes such a task.
    """
    end_tasks(client, futures)
    quiet, keys = 0, {future.key for future in futures}
    while quiet < IDLE_CHECKS:
        answers: SimpleQueue[dict[str, bool]] = SimpleQueue()
        Thread(target=_queue_busy_flags, args=(client, keys, answers), name="ask-workers", daemon=True).start()
        at_work = list[str]()
        with suppress(Empty):  # a frozen worker does not answer, but it computes nothing either
            at_work = [address for address, here in answers.get(timeout=END_SECONDS).items() if here]
        kill_workers(client, at_work)
        quiet = 0 if at_work else quiet + 1
        time.sleep(LOOK_SECONDS)


def _queue_busy_flags(client: Client, keys: set[str], answers: SimpleQueue[dict[str, bool]]) -> None:
    """Put {address of a worker: whether it computes one of the tasks `keys`} into `answers`."""
    with suppress(OSError):  # the scheduler is gone: its workers end, and nothing is put
        answers.put(client.run(_is_computing, keys, on_error="ignore"))


async def _is_computing(keys: set[str], dask_worker: Worker) -> bool:
    return any(task.key in keys for task in dask_worker.state.executing)


async def _end_process(dask_worker: Worker) -> None:
    if dask_worker.nanny:
        os.kill(os.getpid(), signal.SIGKILL)


def _require_answer(url: str) -> None:
    """Raise an error unless a program answers at the address, because a dask client that never connects hangs later."""

    async def connect_once() -> None:
        answer = await comm.connect(url, timeout=CONNECT_SECONDS, **Security().get_connection_args("client"))
        await answer.close()

    # A thread of its own runs the event loop, because a notebook's thread already has one.
    with ThreadPoolExecutor(1) as thread:
        thread.submit(asyncio.run, connect_once()).result()
