"""Compilation of kernels: by numba, into a cache that an edit can never leave stale.

Numba's own cache looks only at the file that holds a function, so it misses an edit in a helper that the function
imports. The directory of ours is named by the sources of the whole library, the compiler's versions and the processor.
docs/decisions/0005-kernel-cache.md
"""

import base64
import fcntl
import hashlib
import inspect
import logging
import os
import pickle
import platform
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache, update_wrapper
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

import llvmlite
import numba
import numpy as np
from llvmlite import binding
from numba import types
from numba.extending import overload, typeof_impl

from rattle.errors import RattleError
from rattle.numerics.processes import environment

if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise RattleError("NUMBA_DISABLE_JIT is set, and without the compiler nothing can be computed: unset it")

log = logging.getLogger(__name__)  # INFO: kernels that are being compiled

COMPUTE_NOTHING = {"plot", "paper", "proof", "resilience", "notebook.py", "precompile.py"}  # of what a survey holds
COMPILE_NOTHING = COMPUTE_NOTHING | {"models"}  # which take what is compiled elsewhere
COMPILE = "import sys; from rattle.numerics.compile import compile_here; compile_here(*sys.argv[1:])"
STEP = "compiling "  # how a line of that process begins that says what it is at
_HERE: list[Path] = []  # notes of what this process compiles for others


@cache
def source_hash() -> str:
    """Hex SHA-256 over the sources that compute: two equal hashes give bit-identical numbers on one machine."""
    return _hash_without(COMPUTE_NOTHING)


def _hash_without(left_out: set[str]) -> str:
    digest = hashlib.sha256()
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        name = path.relative_to(root)
        if name.parts[0] not in left_out:
            digest.update(name.as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def toolchain() -> dict[str, str]:
    """Return the versions and processor features that the last bits of numbers depend on, beside the sources."""
    features = binding.get_host_cpu_features()
    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "processor": f"{platform.machine()} {binding.get_host_cpu_name()}",
        "processor_features": " ".join(sorted(name for name, there in features.items() if there)),
    }


def _root() -> str:
    """Return the directory that the environment names or the usual one.

    Returns
    -------
    str
        Its path; where that cannot be written, a directory for temporary files of this user only.
    """
    if named := os.environ.get("RATTLE_CACHE_DIR"):
        return named
    usual = os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "rattle")
    for root in (usual, os.path.join(tempfile.gettempdir(), f"rattle-cache-{os.getuid()}")):
        with suppress(OSError):
            os.makedirs(root, 0o700, exist_ok=True)
            found = os.lstat(root)
            private = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
            if os.access(root, os.W_OK | os.X_OK) and (root == usual or private):  # what is loaded is executed
                return root
    return usual


@cache
def cache_directory() -> Path:
    """Return the directory of kernels of these sources, at this place, for this compiler and processor."""
    target: Any = numba.config
    key = (_hash_without(COMPILE_NOTHING), __file__, sys.version, toolchain(), target.CPU_NAME, target.CPU_FEATURES)
    return Path(_root(), hashlib.sha256(repr(key).encode()).hexdigest()[:24])


@cache
def can_be_kept() -> bool:
    """Return whether the cache can be written; warn if it cannot.

    Returns
    -------
    bool
        False means that numba would take a directory beside the sources, where code can be stale.
    """
    try:
        cache_directory().mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=cache_directory()).close()
    except OSError as error:
        log.warning(
            "kernels cannot be kept, and every process compiles them (%s): let RATTLE_CACHE_DIR name a directory "
            "that can be written",
            error,
        )
        return False
    return True


#: IEEE arithmetic but for fused multiply-add and the sign of zero; 1/0 is inf, not an exception. Reassociation would
#: break the rounding trick of `rattle.flight.law` and the sums that avoid cancellation.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}, "no_cfunc_wrapper": True}
_ENTRY: dict[str, Any] = _OPTIONS | {"nogil": True, "_nrt": True, "forceinline": False}
_CALLED: Any = _OPTIONS | {"no_cpython_wrapper": True, "_nrt": True, "forceinline": False}
_INLINE: dict[str, Any] = _OPTIONS | {"no_cpython_wrapper": True, "_nrt": False, "forceinline": True}


class Inline:
    """A function that is compiled into its callers; from Python it is the plain function.

    It borrows the arrays that it is given: it neither makes nor returns any, and counts no references to them. In a
    kernel numba counts those of every array of a named tuple at each call, in atomic steps of some nanoseconds.
    """

    all: ClassVar[list["Inline"]] = []

    def __init__(self, function: Callable[..., Any], options: Mapping[str, Any] = _INLINE) -> None:
        update_wrapper(self, function)
        self.name = function.__name__
        self.in_kernels, self._run = numba.njit(**options)(function), function
        if options is _INLINE:
            Inline.all.append(self)

    def __call__(self, *arguments: Any) -> Any:
        """Run the compiled function."""
        return self._run(*arguments)


@typeof_impl.register(Inline)
def _type_in_kernels(function: Inline, _context: Any) -> Any:
    return numba.typeof(function.in_kernels)


class Kernel(Inline):
    """A compiled function with an entry from Python, which is kept on disk.

    Kernels that call it have copies of their own: those of one name are alike, whichever of them a process loads first.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function, _CALLED)
        config: Any = numba.config
        before, config.CACHE_DIR = config.CACHE_DIR, str(cache_directory())  # read when a function is decorated
        try:
            self.entry = numba.njit(cache=can_be_kept(), **_ENTRY)(function)
        finally:
            config.CACHE_DIR = before
        self._run = self._first

    def _first(self, *arguments: Any) -> Any:
        """Call it when a process of its own has compiled it for such arguments."""
        if self.__module__.startswith("rattle."):
            wanted = self.__module__, self.name, *map(numba.typeof, arguments)
            name = hashlib.sha256(repr(wanted).encode()).hexdigest()[:24]  # pickles of the same may differ
            compile_apart(__name__, "one", f"{name} {base64.b64encode(pickle.dumps(wanted)).decode()}")
        self._run = self.entry
        return self.entry(*arguments)


def one(about: str) -> dict[str, Callable[[], Any]]:
    """Return what compiles a kernel for some types of arguments."""
    module, name, *arguments = pickle.loads(base64.b64decode(about.split()[1]))
    return {name: lambda: getattr(import_module(module), name).entry.compile(tuple(arguments))}


def kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a kernel on first call, and cache it on disk; other threads run meanwhile."""
    return Kernel(function)


def inline(function: Callable[..., Any]) -> Inline:
    """Compile a small function into its callers: a loop over it stays one straight line, which LLVM vectorises."""
    return Inline(function)


#: Functions that kernels find by the type of their last argument: for each, its implementation for every type.
FOR_TYPES: dict[Callable[..., Any], dict[type, Callable[..., Any]]] = {}


def for_type(function: Callable[..., Any], kind: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Declare that a function is, inside kernels whose last argument is a named tuple of this kind, the decorated one.

    `FOR_TYPES` has all of them, and the docstring of `rattle.orbits.return_map` lists them with their places. Kernels
    are not passed as arguments instead: numba's cache on disk does not know those (docs/decisions/0018-stiff.md).

    Returns
    -------
    Callable
        A decorator that returns its argument.
    """

    def register(implementation: Callable[..., Any]) -> Callable[..., Any]:
        FOR_TYPES.setdefault(function, {})[kind] = implementation

        def choose(*arguments: Any) -> Any:
            return implementation if getattr(arguments[-1], "instance_class", None) is kind else None

        chooser: Any = choose
        chooser.__signature__ = inspect.signature(implementation)  # numba matches arguments by their names
        overload(function, strict=False, jit_options=_CALLED)(chooser)
        return implementation

    return register


def note_of(work: str, about: str) -> Path:
    """Return the file which says that the kernels for this work are in the cache."""
    return cache_directory() / f"{work}-{about.split()[0]}.note"


def compile_apart(module: str, work: str, about: str) -> None:
    """Compile the kernels for some work in a process of their own, unless that was done before.

    Numba's functions are weak symbols: a process that compiles takes copies of them which are optimised otherwise than
    those that it loads, and the last bits differ. So every process loads its kernels. One at a time compiles; others
    wait for it.

    Parameters
    ----------
    module, work : str
        A function and where it is; it returns steps by name, which compile what they need.
    about : str
        What the function takes: a model; or a name, and more.

    Raises
    ------
    RattleError
        They cannot be compiled; the message says why.
    """
    note = note_of(work, about)
    if note.exists() or not sys.executable or not can_be_kept():
        return
    if _HERE:  # this process compiles for others
        _HERE.append(note)
        return
    with open(note.with_name("lock"), "w") as lock:
        with suppress(OSError):  # without it, where files cannot be locked, kernels are compiled twice
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not note.exists():
            _compile(module, work, about)


def _compile(*work: str) -> None:
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    said: list[str] = []
    with subprocess.Popen([sys.executable, "-c", COMPILE, *work], env=environment(), **pipes) as process:
        try:
            for line in process.stdout or ():
                said.append(line)
                if line.startswith(STEP):
                    log.info(said.pop().strip())
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        raise RattleError(f"kernels cannot be compiled: {''.join(said[-20:]).strip() or process.returncode}")


def compile_here(module: str, work: str, about: str) -> None:
    """Do the steps of this work in this process, which ends when the one that started it does."""
    threading.Thread(target=lambda: sys.stdin.read() or os._exit(1), daemon=True).start()
    _HERE.append(note_of(work, about))
    steps = getattr(import_module(module), work)(about)
    for number, (name, step) in enumerate(steps.items(), 1):
        print(f"{STEP}{name}{f' of the {about} model' * about.isalpha()}, {number} of {len(steps)}", flush=True)
        step()
    require_borrowed()
    for note in _HERE:
        note.touch()


def require_borrowed() -> None:
    """Refuse inline functions that return an array: their callers would give back what they were never given.

    Raises
    ------
    RattleError
        One that this process has compiled does.
    """
    for each in Inline.all:
        if any(_holds_array(signature.return_type) for signature in each.in_kernels.nopython_signatures):
            raise RattleError(f"{each.name} is inline and returns an array: make it a kernel")


def _holds_array(kind: Any) -> bool:
    if isinstance(kind, types.Optional):
        return _holds_array(kind.type)
    parts: Any = kind if isinstance(kind, types.BaseTuple) else ()
    return isinstance(kind, types.Array) or any(_holds_array(each) for each in parts)
