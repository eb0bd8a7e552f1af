"""Compile kernels by numba, with a cache on disk that holds no outdated kernel after an edit of the sources.

Numba's own cache looks only at the file that holds a function, so it misses an edit in a helper that the function
imports. The name of our cache directory is a hash of the library's sources, the compiler's versions and the processor.
docs/decisions/0005-kernel-cache.md
"""

import base64
import fcntl
import gc
import hashlib
import inspect
import logging
import os
import pickle
import platform
import re
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache, cached_property, update_wrapper
from importlib import import_module
from pathlib import Path
from typing import IO, Any, ClassVar

import llvmlite
import numba
import numpy as np
from llvmlite import binding
from numba.extending import overload, typeof_impl

from rattle.errors import RattleError
from rattle.numerics.processes import child_process_environment

if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise RattleError("NUMBA_DISABLE_JIT is set, but all computations need Numba's compiler: unset NUMBA_DISABLE_JIT")

log = logging.getLogger(__name__)  # a message of level INFO names each step of a compilation when it begins

#: Parts of the library that compute no number of a survey.
COMPUTE_NOTHING = {"plot", "paper", "proof", "resilience", "notebook.py", "precompile.py"}
#: Parts of the library that define no kernels. `models` computes, but by calling kernels of other parts.
COMPILE_NOTHING = COMPUTE_NOTHING | {"models"}
COMPILE = (
    "import sys; from rattle.numerics.compile import compile_in_this_process; compile_in_this_process(*sys.argv[1:])"
)
STEP = "compiling "  # the lines in which the compiling process reports its steps begin with this word
POLL_SECONDS = 0.1
# paths of the files that this process creates when its kernels are compiled; empty except in the compiling process
_CREATED_NOTES: list[Path] = []
_LOCK = threading.Lock()


@cache
def source_hash() -> str:
    """Return the hex SHA-256 of all sources of the library except the files and folders in COMPUTE_NOTHING.

    Returns
    -------
    str
        The hash. On one machine with the same `toolchain`, equal hashes mean that computed numbers are equal to the
        last bit.
    """
    return _hash_sources(COMPUTE_NOTHING)


def _hash_sources(left_out: set[str]) -> str:
    """Return the hex SHA-256 of the library's sources without the folders and files `left_out`."""
    digest, root = hashlib.sha256(), Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        name = path.relative_to(root)
        if name.parts[0] not in left_out:
            digest.update(name.as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def toolchain() -> dict[str, str]:
    """Return the versions and processor features on which, besides the sources, the last bits of numbers depend."""
    features = binding.get_host_cpu_features()
    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "processor": f"{platform.machine()} {binding.get_host_cpu_name()}",
        "processor_features": " ".join(sorted(name for name, there in features.items() if there)),
    }


def _cache_root() -> str:
    """Return the directory that holds the kernel caches of all versions of the library.

    Returns
    -------
    str
        RATTLE_CACHE_DIR if this variable is set; otherwise a directory in the user's cache or, if this directory cannot
        be written, a private temporary directory. If neither can be written, the directory in the user's cache.
    """
    if named := os.environ.get("RATTLE_CACHE_DIR"):
        return named
    usual = os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "rattle")
    for root in (usual, os.path.join(tempfile.gettempdir(), f"rattle-cache-{os.getuid()}")):
        with suppress(OSError):
            os.makedirs(root, 0o700, exist_ok=True)
            found = os.lstat(root)
            private = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
            # a temporary directory must be private, because files in it are executed
            if os.access(root, os.W_OK | os.X_OK) and (root == usual or private):
                return root
    return usual


@cache
def cache_directory() -> Path:
    """Return the directory of compiled kernels: its name is a hash of sources, their path, compiler and processor."""
    target: Any = numba.config
    key = (_hash_sources(COMPILE_NOTHING), __file__, sys.version, toolchain(), target.CPU_NAME, target.CPU_FEATURES)
    return Path(_cache_root(), hashlib.sha256(repr(key).encode()).hexdigest()[:24])


@cache
def is_cache_writable() -> bool:
    """Return whether the cache can be written, and log a warning if it cannot.

    Returns
    -------
    bool
        If False, every process compiles its own kernels. Numba's own cache, whose kernels may be stale, is not used.
    """
    try:
        cache_directory().mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=cache_directory()).close()
    except OSError as error:
        advice = "let RATTLE_CACHE_DIR name a directory that can be written"
        log.warning("kernels cannot be kept, and every process compiles them (%s): %s", error, advice)
        return False
    return True


#: Arithmetic follows IEEE 754, except that multiply-add may be fused and the sign of zero may change; 1/0 is inf, not
#: an exception. Reassociation would break the rounding trick of `rattle.flight.forcing` and sums that avoid
#: cancellation.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}, "no_cfunc_wrapper": True}
_ENTRY: dict[str, Any] = _OPTIONS | {"nogil": True, "_nrt": True, "forceinline": False}
_CALLED: Any = _OPTIONS | {"no_cpython_wrapper": True, "_nrt": True, "forceinline": False}
_INLINE: dict[str, Any] = _OPTIONS | {"no_cpython_wrapper": True, "_nrt": False, "forceinline": True}


class InlineFunction:
    """A function that is compiled into the kernels that call it; a call from Python runs the plain Python function.

    The function borrows its array arguments: it neither creates nor returns arrays, and counts no references to them.
    If it counted them, each call would cost some nanoseconds for every array of a named tuple. Numba's dispatchers are
    created when they are first needed, because a process that only loads kernels needs few of them.
    """

    options = _INLINE
    compiled: ClassVar[list["InlineFunction"]] = []

    def __init__(self, function: Callable[..., Any]) -> None:
        update_wrapper(self, function)
        self.name, self._run = function.__name__, function

    @cached_property
    def kernel_dispatcher(self) -> Any:
        """Numba's dispatcher for calls from kernels. It compiles the function for each set of argument types."""
        InlineFunction.compiled.append(self)
        return numba.njit(**self.options)(self._run)

    def __call__(self, *arguments: Any) -> Any:
        """Run the plain Python function."""
        return self._run(*arguments)


@typeof_impl.register(InlineFunction)
def _numba_type_of_inline(function: InlineFunction, _context: Any) -> Any:
    return numba.typeof(function.kernel_dispatcher)


class Kernel(InlineFunction):
    """A compiled function that Python can call. Its machine code is kept on disk.

    If a kernel calls another kernel, it contains a copy of the other's machine code. All copies are identical, so the
    results do not depend on the order in which a process loads kernels.
    """

    options = _CALLED
    _python_dispatcher: Any = None

    @property
    def python_dispatcher(self) -> Any:
        """Numba's dispatcher for calls from Python. It compiles the function for each set of argument types."""
        config: Any = numba.config
        with _LOCK:
            if self._python_dispatcher is None:
                before, config.CACHE_DIR = (
                    config.CACHE_DIR,
                    str(cache_directory()),
                )  # numba reads CACHE_DIR only in `njit`, so it is set for that call alone
                try:
                    self._python_dispatcher = numba.njit(cache=is_cache_writable(), **_ENTRY)(self._run)
                finally:
                    config.CACHE_DIR = before
        return self._python_dispatcher

    def __call__(self, *arguments: Any) -> Any:
        """Run the compiled function. Before its first run, a separate process compiles it for these argument types."""
        if self._python_dispatcher is None and self.__module__.startswith("rattle."):
            wanted = self.__module__, self.name, *map(numba.typeof, arguments)
            # the name of the job is a hash of the types as text, because pickles of equal types may differ
            name = hashlib.sha256(repr(wanted).encode()).hexdigest()[:24]
            compile_in_subprocess(
                f"{name} {base64.b64encode(pickle.dumps(wanted)).decode()}", f"{__name__}:kernel_compilation_steps"
            )
        return (self._python_dispatcher or self.python_dispatcher)(*arguments)


def kernel_compilation_steps(about: str) -> dict[str, Callable[[], Any]]:
    """Return the step of a `compile_in_subprocess` job that compiles one kernel for given argument types.

    about: a hash, a space, and in base64 the pickled tuple of the kernel's module, its name and the types.

    Returns
    -------
    dict
        {name of the kernel: function that compiles it}.
    """
    module, name, *arguments = pickle.loads(base64.b64decode(about.split()[1]))
    return {name: lambda: getattr(import_module(module), name).python_dispatcher.compile(tuple(arguments))}


kernel = Kernel  #: decorator: compiles at the first call, caches on disk, runs without the GIL
#: decorator: compiles a small function into its callers, so that LLVM can vectorise loops that call it
inline = InlineFunction

#: For each generic function its implementations, one for each type of its last argument. Kernels choose by that type.
FOR_TYPES: dict[Callable[..., Any], dict[type, Callable[..., Any]]] = {}


def implement_for_type(function: Callable[..., Any], kind: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Declare the implementation of `function` for kernels whose last argument has the type `kind`, a named tuple.

    `FOR_TYPES` has all implementations, and the docstring of `rattle.orbits.return_map` lists where they are. Kernels
    are not passed as arguments instead, because numba's cache on disk does not support that
    (docs/decisions/0018-stiff.md).

    Returns
    -------
    Callable
        A decorator for the implementation, which it returns unchanged.
    """

    def register(implementation: Callable[..., Any]) -> Callable[..., Any]:
        FOR_TYPES.setdefault(function, {})[kind] = implementation

        def choose(*arguments: Any) -> Any:
            return implementation if getattr(arguments[-1], "instance_class", None) is kind else None

        chooser: Any = choose
        # numba requires that `chooser` and the implementation have the same argument names
        chooser.__signature__ = inspect.signature(implementation)
        overload(function, strict=False, jit_options=_CALLED)(chooser)
        return implementation

    return register


def completion_note_path(about: str, job: str) -> Path:
    """Return the path of the file whose existence marks a job of `compile_in_subprocess` as done.

    about: the argument of the job; only its first word enters the path. job: the job's function, ``module:name``.

    Returns
    -------
    Path
        A path in the cache directory. The file may not exist.
    """
    return cache_directory() / f"{job.rpartition(':')[2]}-{about.split()[0]}.note"


def compile_in_subprocess(about: str, *jobs: str) -> None:
    """Compile the kernels of the jobs `jobs` in one separate process, unless the cache has them already.

    Numba's functions are weak symbols: a process that compiles a kernel takes copies of its callees that are optimised
    differently from the copies that it loads from the cache, and the last bits of results differ. So every process
    loads its kernels. One process at a time compiles, and the others wait for it. Jobs that are compiled together share
    the callees of their kernels.

    Parameters
    ----------
    about : str
        The argument of the jobs, such as the name of a model. Its first word tells calls of one job apart; a job is not
        repeated for the same first word.
    *jobs : str
        Jobs: functions, as ``module:name``, which take `about` and return steps by name. Each step is a function that
        compiles the kernels that it needs.

    Raises
    ------
    RattleError
        If the kernels cannot be compiled; the message says why.
    """
    notes = [completion_note_path(about, job) for job in jobs]
    if _CREATED_NOTES:  # this is the compiling process, which compiles these kernels itself when its job calls them
        _CREATED_NOTES.extend(notes)
    elif sys.executable and not all(note.exists() for note in notes) and is_cache_writable():
        with open(cache_directory() / "lock", "w") as lock:
            while not try_to_lock(lock) and not all(note.exists() for note in notes):
                time.sleep(POLL_SECONDS)
            if missing := [job for job, note in zip(jobs, notes, strict=True) if not note.exists()]:
                _compile_in_new_process(about, *missing)


def try_to_lock(file: IO[str]) -> bool:
    """Lock a file. Return False if another process has locked it, and True also if the file system has no locks."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def _compile_in_new_process(*arguments: str) -> None:
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    said: list[str] = []
    with subprocess.Popen(
        [sys.executable, "-c", COMPILE, *arguments], env=child_process_environment(), **pipes
    ) as process:
        try:
            for line in process.stdout or ():
                said.append(line)
                if line.startswith(STEP):
                    log.info(said.pop().strip())
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        code = f"the compiling process ended with code {process.returncode}"
        raise RattleError(f"kernels cannot be compiled: {''.join(said[-20:]).strip() or code}")


def compile_in_this_process(about: str, *jobs: str) -> None:
    """Compile the kernels of these jobs in this process, and mark each job as done.

    This process ends when its standard input closes, as it does when the parent process ends. about, jobs: as in
    `compile_in_subprocess`.
    """
    threading.Thread(target=lambda: sys.stdin.read() or os._exit(1), daemon=True).start()
    gc.set_threshold(100_000, 20, 20)  # the default thresholds spend an eighth of a compilation's time on garbage
    for job in jobs:
        _CREATED_NOTES[:] = [completion_note_path(about, job)]
        module, _, name = job.partition(":")
        steps = getattr(import_module(module), name)(about)
        for number, (step, compile_step) in enumerate(steps.items(), 1):
            print(f"{STEP}{step}{f' of the {about} model' * about.isalpha()}, {number} of {len(steps)}", flush=True)
            compile_step()
        refuse_array_returns()
        for note in _CREATED_NOTES:
            note.touch()


def refuse_array_returns() -> None:
    """Refuse inline functions that return an array: their callers would release a reference that was not counted.

    Raises
    ------
    RattleError
        If an inline function that this process has compiled returns an array.
    """
    for each in InlineFunction.compiled:
        returned = [str(signature.return_type) for signature in each.kernel_dispatcher.nopython_signatures]
        if each.options is _INLINE and any(re.search(r"\barray\(", kind) for kind in returned):
            raise RattleError(f"{each.name} is inline and returns an array: make it a kernel")
