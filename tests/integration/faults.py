"""Faults put into real processes from outside, and a count of what they execute.

Every process that inherits the environment made here patches modules as it imports them, also the processes that it
starts. Nothing in the code under test knows of it.
"""

import os
import textwrap
from collections import Counter
from pathlib import Path

from service_processes import ENVIRONMENT, ROOT

from workers import Axis, SurveyRequest

#: 256 cells in 64 tiles.
REQUEST = SurveyRequest(
    delta=Axis(start=0.58, stop=0.78, num=16),
    epsilon=Axis(start=0.05, stop=0.24, num=16),
    initial_conditions={"count": 4},
    tile={"delta": 2, "epsilon": 2},
)

_HOOK = """
import importlib.util, os, signal, sys, time
LOG = {log!r}

def note(line):
    with open(LOG, "a") as log:  # short appends are whole
        log.write(line + "\\n")

def die():
    os.kill(os.getpid(), signal.SIGKILL)

def in_service():
    return "service.jobs" in sys.modules

def before(module, name, act):
    function = getattr(module, name)
    def patched(*args, **kwargs):
        act(*args, **kwargs)
        return function(*args, **kwargs)
    setattr(module, name, patched)

def after(module, name, act):
    function = getattr(module, name)
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

@patch("workers.tiles")
def count(tiles):
    before(tiles, "compute_tile", lambda request, tile, outcomes=None: note(f"tile {{tile.index}}"))
"""


class Faults:
    """A directory of patches: put its `environment` around the processes that shall have them."""

    def __init__(self, directory: Path) -> None:
        self._directory, self._log = directory / "faults", directory / "executed"
        self._directory.mkdir()
        self._log.touch()
        self.inject("")

    def inject(self, patches: str) -> None:
        """Replace the patches, for processes that start from now on; executions are always counted."""
        (self._directory / "sitecustomize.py").write_text(_HOOK.format(log=str(self._log)) + textwrap.dedent(patches))

    @property
    def environment(self) -> dict[str, str]:
        return {**ENVIRONMENT, "PYTHONPATH": os.pathsep.join([str(self._directory), str(ROOT)])}

    def notes(self, word: str) -> Counter[str]:
        """How often each thing was noted under this word."""
        lines = (line.partition(" ") for line in self._log.read_text().splitlines())
        return Counter(rest for first, _, rest in lines if first == word)

    def executions(self) -> Counter[int]:
        """How often each tile has begun, by index."""
        return Counter({int(index): times for index, times in self.notes("tile").items()})
