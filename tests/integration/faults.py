"""Faults injected into real processes, a count of the tiles that they execute, and tiles that wait for a release.

Every process with the environment made here patches modules when it imports them, and so do the processes that it
starts. The code under test contains nothing for this.
"""

import os
import textwrap
from collections import Counter
from pathlib import Path

from service_processes import ENVIRONMENT, ROOT

from gear_rattle.workers import Axis, SurveyRequest

#: 64 cells in 16 tiles.
REQUEST = SurveyRequest(
    delta=Axis(start=0.58, stop=0.78, num=8),
    epsilon=Axis(start=0.05, stop=0.24, num=8),
    initial_conditions={"count": 4},
    tile={"delta": 2, "epsilon": 2},
)

_HOOK = """
import functools, importlib.util, os, signal, sys, time
LOG, HOLD, ARMED = {log!r}, {hold!r}, {armed!r}

def note(line):
    with open(LOG, "a") as log:  # short appends are whole
        log.write(line + "\\n")

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def in_service():
    return "gear_rattle.service.jobs.manager" in sys.modules

def before(module, name, act):
    function = getattr(module, name)
    @functools.wraps(function)
    def patched(*args, **kwargs):
        act(*args, **kwargs)
        return function(*args, **kwargs)
    setattr(module, name, patched)

def after(module, name, act):
    function = getattr(module, name)
    @functools.wraps(function)
    def patched(*args, **kwargs):
        result = function(*args, **kwargs)
        act(*args, **kwargs)
        return result
    setattr(module, name, patched)

PATCHES = {{}}

def at_call(number, act):
    calls = []
    def acting(*args, **kwargs):
        calls.append(1)
        if len(calls) == number:
            act()
    return acting

def patch(name):
    return lambda function: PATCHES.setdefault(name, []).append(function)

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name not in PATCHES:
            return None
        sys.meta_path.remove(self)
        try:
            spec = importlib.util.find_spec(name)
        finally:
            sys.meta_path.insert(0, self)
        execute = spec.loader.exec_module
        def exec_module(module):
            execute(module)
            for function in PATCHES[name]:
                function(module)
        spec.loader.exec_module = exec_module
        return spec

sys.meta_path.insert(0, Finder())

def held(index):
    try:
        with open(HOLD) as file:
            return index >= int(file.read())
    except FileNotFoundError:
        return False

def disarmed(word):
    try:
        os.unlink(ARMED + word)  # in one process of all
    except FileNotFoundError:
        return False
    return True

@patch("gear_rattle.workers.survey.tiles")
def count(tiles):
    def act(request, tile, outcomes=None):
        note(f"tile {{tile.index}} {{os.getpid()}}")
        while held(tile.index):
            time.sleep(0.01)
    before(tiles, "compute_tile", act)
"""

#: A cluster in the process of the service. It starts fast, because it loads kernels only when it needs them, and a kill
#: of the service ends it.
IN_PROCESS = """
    @patch("gear_rattle.workers.cluster.cluster")
    def inside(cluster):
        spec = cluster.SpecCluster
        def start(scheduler, security):
            worker = {"host": "127.0.0.1", "security": security, "nthreads": 1, "extensions": {}, "dashboard": False}
            return spec({0: {"cls": cluster.Worker, "options": worker}}, scheduler=scheduler, security=security)
        async def nothing(self, worker):
            pass
        cluster.SpecCluster, cluster.KernelLoader.setup = start, nothing
        cluster._WorkerProcesses._run_nanny_process = lambda self: self._over.wait()
"""

#: A survey of 9 tiles that has to meet a bound. With FEW_AUDITED, its tiles go through a further round.
BOUNDED = SurveyRequest(
    delta=Axis(start=0.4, stop=1.0, num=96),
    epsilon=Axis(start=0.005, stop=0.3, num=70),
    quantities=("region",),
    refine={"audit": 0.001, "bound": 0.02},
    tile={"delta": 32, "epsilon": 32},
    seed=15,
)
SPARE = 0.1
FEW_AUDITED = f"""
    @patch("gear_rattle.workers.survey.refined.rounds")
    def few_audited(rounds):
        rounds.FIRST_AUDIT_FACTOR = {SPARE}
"""

#: A service without a deadline: its stop hangs unless the service itself ends everything that is open.
NO_DEADLINE = """
    @patch("gear_rattle.service.web.server")
    def patient(server):
        server.STOP_SECONDS = 1e6
        config = server.uvicorn.Config
        after(config, "__init__", lambda self, *_, **__: setattr(self, "timeout_graceful_shutdown", None))
"""


class Faults:
    """A directory of patches; processes started with its `environment` have them."""

    def __init__(self, directory: Path) -> None:
        self._directory, self._log, self._hold = directory / "faults", directory / "executed", directory / "hold"
        self._armed = directory / "armed-"
        self._directory.mkdir()
        self._log.touch()
        self.inject("")

    def inject(self, *patches: str) -> None:
        """Replace the patches of processes that start from now on; executions are always counted."""
        hook = _HOOK.format(log=str(self._log), hold=str(self._hold), armed=str(self._armed))
        (self._directory / "sitecustomize.py").write_text(hook + "".join(map(textwrap.dedent, patches)))

    def hold(self, first: int) -> None:
        """Hold the tiles from this index on: they begin, and do not end until :meth:`release`."""
        new = self._hold.with_suffix(".new")
        new.write_text(str(first))
        new.rename(self._hold)

    def release(self) -> None:
        """Release every tile that is held."""
        self._hold.unlink(missing_ok=True)

    def arm(self, word: str) -> None:
        """Let the fault that asks `disarmed(word)` happen once."""
        Path(f"{self._armed}{word}").touch()

    def forget(self) -> None:
        """Remove all notes, so that counts begin at zero."""
        self._log.write_text("")

    @property
    def environment(self) -> dict[str, str]:
        return {**ENVIRONMENT, "PYTHONPATH": os.pathsep.join([str(self._directory), str(ROOT)])}

    def notes(self, word: str) -> Counter[str]:
        """Return how often each text was noted after this word."""
        lines = (line.partition(" ") for line in self._log.read_text().splitlines())
        return Counter(rest for first, _, rest in lines if first == word)

    def executions(self) -> Counter[int]:
        """Return how often each tile has begun, by index."""
        return self._begun(0)

    def processes(self) -> set[int]:
        """Return the id of every process in which a tile has begun."""
        return set(self._begun(1))

    def _begun(self, column: int) -> Counter[int]:
        return Counter(int(line.split()[column]) for line in self.notes("tile").elements())
