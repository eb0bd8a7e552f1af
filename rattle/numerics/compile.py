"""How kernels are compiled: one decorator, and a disk cache that an edit can never leave stale.

Numba's own cache looks only at the file that holds a function, so it misses an edit in a helper that the function
imports. Ours is keyed by the sources of the whole library, the compiler's versions and the processor. Processes share
it: the first that needs a kernel compiles it, the others wait for its file.
"""

import fcntl
import gc
import hashlib
import inspect
import logging
import os
import platform
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, update_wrapper
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from llvmlite import binding
from llvmlite.binding import Linkage
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.runtime import rtsys
from numba.extending import overload

from rattle.errors import RattleError

if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    raise RattleError("NUMBA_DISABLE_JIT is set, and without the compiler nothing can be computed: unset it")

log = logging.getLogger(__name__)  # INFO: a kernel that is compiled, not loaded

LOCK_POLL_SECONDS, SAID_SECONDS, SUSPENDED_SECONDS = 0.05, 1.0, 120.0
OBJECTS = 50_000  # that are made between two collections of garbage; Python's own default is 700

COMPUTE_NOTHING = {"plot", "paper", "proof", "resilience", "notebook.py", "warm.py"}  # of what a survey holds


@cache
def source_hash() -> str:
    """Hex SHA-256 over the sources that compute: two equal hashes give bit-identical numbers on one machine."""
    digest = hashlib.sha256()
    root = Path(__file__).parents[1]
    for path in sorted(root.rglob("*.py")):
        name = path.relative_to(root)
        if name.parts[0] not in COMPUTE_NOTHING:
            digest.update(name.as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def toolchain() -> dict[str, str]:
    """What the last bits of numbers depend on beside the sources: versions, and the processor with its features."""
    features = binding.get_host_cpu_features()
    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "processor": f"{platform.machine()} {binding.get_host_cpu_name()}",
        "processor_features": " ".join(sorted(name for name, there in features.items() if there)),
    }


@cache
def _default_root(usual: str) -> str:
    """Return the usual directory or, where it cannot be written, a directory for temporary files of this user only."""
    for root in (usual, os.path.join(tempfile.gettempdir(), f"rattle-cache-{os.getuid()}")):
        with suppress(OSError):
            os.makedirs(root, 0o700, exist_ok=True)
            found = os.lstat(root)
            private = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
            if os.access(root, os.W_OK | os.X_OK) and (root == usual or private):  # what is loaded is executed
                return root
    return usual


def _cache_directory() -> str:
    root = os.environ.get("RATTLE_CACHE_DIR") or _default_root(
        os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "rattle")
    )
    toolchain = (sys.version, platform.machine(), numba.__version__, llvmlite.__version__, np.__version__)
    key = hashlib.sha256(repr((source_hash(), toolchain)).encode()).hexdigest()[:24]
    return os.path.join(root, key)


def note_in_cache(name: str) -> Path:
    """Where a note about this cache may be left, such as that it is complete; of this processor, as its kernels are."""
    processor = f"{binding.get_host_cpu_name()} {binding.get_host_cpu_features().flatten()}"
    return Path(_cache_directory(), f"{name}-{hashlib.sha256(processor.encode()).hexdigest()[:12]}.note")


#: IEEE arithmetic but for fused multiply-add and the sign of zero; 1/0 is inf, not an exception. Reassociation would
#: break the rounding trick of `rattle.flight.law` and the sums that avoid cancellation.
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "nsz"},
    "no_cfunc_wrapper": True,
    "_nrt": True,
}
_INSIDE: dict[str, Any] = _OPTIONS | {"no_cpython_wrapper": True}


def _with_room(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


# Python keeps its frames in pieces of 16 KiB. Where a call that the compiler makes often crosses from one to the next,
# a piece is mapped and unmapped every time: 460,000 times, a fifth of a cold start. A frame that says it needs a
# mebibyte gets a piece of two, and the frames above it share what is left.
_with_room.__code__ = _with_room.__code__.replace(co_stacksize=1 << 17)


class _Collections:
    """Garbage is collected seldom while a kernel is loaded or compiled: there is next to none among a hundred thousand
    new objects, and to look for it took a third of a process's start.
    """

    def __init__(self) -> None:
        self._lock, self._inside = threading.Lock(), 0
        self._before = gc.get_threshold()

    def __enter__(self) -> None:
        with self._lock:
            self._inside += 1
            if self._inside == 1:
                self._before = gc.get_threshold()
                if 0 < self._before[0] < OBJECTS:  # 0: never
                    gc.set_threshold(OBJECTS, *self._before[1:])

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                gc.set_threshold(*self._before)


_seldom_collected = _Collections()


WIDE = '"prefer-vector-width"="512"'
ICE_LAKE = "+avx512vbmi2"  # what those processors lack that run slower while their vectors are wide


class _Wide(JITCodeLibrary):
    """Code with vectors of 512 bits where the processor has them and loses nothing by them.

    LLVM takes 256 on every processor of Intel's. An attribute of functions leaves the rest of the process's alone.
    """

    def add_ir_module(self, ir_module: Any) -> None:
        if ICE_LAKE in self._codegen._tm_features.split(","):
            for function in ir_module.functions:
                if not function.is_declaration:
                    set.add(function.attributes, WIDE)  # its own `add` knows no attributes with a value
        super().add_ir_module(ir_module)


class _OwnCopies(_Wide):
    """Compiled code in which functions that were linked in are its own.

    Otherwise they are weak symbols, of which a process takes the first that it meets: while it compiles that of another
    library, optimised by itself, and from the cache the copy beside its callers. Their last bits differ.
    """

    def _optimize_final_module(self) -> None:
        super()._optimize_final_module()
        for function in self._final_module.functions:  # not before: what is known to be internal is inlined too eagerly
            if function.linkage == Linkage.linkonce_odr and not function.is_declaration:
                function.linkage = Linkage.internal


class _WithoutMachineCode:
    """A code generator that makes no machine code, else as the one that it stands for."""

    def __init__(self, codegen: Any) -> None:
        self._codegen = codegen

    def __getattr__(self, name: str) -> Any:
        return getattr(self._codegen, name)

    def _add_module(self, module: Any) -> None:
        pass

    def set_env(self, name: str, env: Any) -> None:
        pass


class _LinkedOnly(_Wide):
    """Code that is linked into its callers: nobody runs its own, and it is optimised in full with them, once."""

    def _optimize_final_module(self) -> None:
        codegen = self._codegen
        passes = codegen._module_pass_manager(
            loop_vectorize=codegen._loopvect, slp_vectorize=False, opt=codegen._opt_level, cost="cheap"
        )
        if isinstance(passes, tuple):  # since numba 0.62: the passes, and what runs them
            passes[0].run(self._final_module, passes[1])
        else:
            passes.run(self._final_module)

    def _finalize_specific(self) -> None:
        pass

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002 - numba's
        return 0


class _InsideCompiler(Compiler):
    """Compiles what kernels call."""

    def define_pipelines(self) -> Any:
        codegen = _WithoutMachineCode(self.state.targetctx.codegen())
        self.state.library = _LinkedOnly(codegen, self.state.func_id.func_qualname)
        return super().define_pipelines()


class _EntryCompiler(Compiler):
    """Compiles what Python calls."""

    def define_pipelines(self) -> Any:
        self.state.library = _OwnCopies(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


@cache
def can_be_kept() -> bool:
    """Whether the cache can be written; says so if not. Numba would take a directory beside the sources, where code can
    be stale.
    """
    try:
        os.makedirs(_cache_directory(), exist_ok=True)
        tempfile.TemporaryFile(dir=_cache_directory()).close()
    except OSError as error:
        log.warning(
            "kernels cannot be kept, and every process compiles them (%s): let RATTLE_CACHE_DIR name a directory "
            "that can be written",
            error,
        )
        return False
    return True


@contextmanager
def _alone(path: str, what: str) -> Iterator[None]:
    """Hold a lock file, which ends with the process that holds it.

    Without it where files cannot be locked, and after a time that only a process meets which has been suspended: then
    a kernel is compiled twice.
    """
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError:
        yield
        return
    try:
        began, said = time.monotonic(), False
        while not _locked(file) and time.monotonic() < began + SUSPENDED_SECONDS:
            if not said and time.monotonic() > began + SAID_SECONDS:
                said = True
                log.info("waiting for another process to compile %s", what)
            time.sleep(LOCK_POLL_SECONDS)
        yield
    finally:
        os.close(file)


@contextmanager
def unless_elsewhere(what: str) -> Iterator[bool]:
    """Whether no other process is at this piece of compiling, which is this one's then; nobody waits for it."""
    try:
        file = os.open(os.path.join(_cache_directory(), f"{what}.part"), os.O_RDWR | os.O_CREAT, 0o600)
    except OSError:  # nothing can be kept: nobody else does anything for this process
        yield True
        return
    try:
        yield _locked(file)
    finally:
        os.close(file)


def _locked(file: int) -> bool:
    """Take the lock if nobody has it; True where files cannot be locked at all."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        log.debug("the cache of kernels is not locked: %s", error)
    return True


class _OfTheseSources:
    """Where the files of a kernel are: the directory is named by all sources, wherever they are, and says all of them.

    Numba's own locators add the path of the file, and read and hash it, for each kernel of each process.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._path = os.path.join(_cache_directory(), function.__module__)
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> "_OfTheseSources":  # noqa: ARG003 - numba's
        return cls(function)

    def get_cache_path(self) -> str:
        return self._path

    def ensure_cache_path(self) -> None:
        os.makedirs(self._path, exist_ok=True)

    def get_source_stamp(self) -> str:
        return ""

    def get_disambiguator(self) -> str:
        return str(self._line)


class _Files(CompileResultCacheImpl):
    _locator_classes: Any = (_OfTheseSources,)


class _SharedCache(FunctionCache):
    """Files of one kernel; says when there is none to load."""

    _impl_class = _Files

    def has(self, signature: Any, target_context: Any) -> bool:
        """Whether it can be loaded: its file is there, which is written whole, but after its entry in the index."""
        files = self._cache_file
        name = files._load_index().get(self._index_key(signature, target_context.codegen()))
        return name is not None and os.path.exists(files._data_path(name))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        # Not as numba does it, which first loads all that it compiles with, scipy's linear algebra too: 0.3 s, and what
        # compiles loads it by itself.
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target_context)
        if found is None:
            log.info("compiling %s", self._py_func.__qualname__)
        return found


def _share(dispatcher: Any) -> None:
    """Let one process at a time compile a kernel: whoever waited loads what the other has compiled. Who only loads it
    neither waits nor is waited for: it may be suspended meanwhile.
    """
    if not can_be_kept():
        return
    function = dispatcher.py_func
    files = dispatcher._cache = _SharedCache(function)
    name = f"{function.__module__}.{function.__qualname__}".replace("<locals>.", "")
    compile_here = dispatcher.compile

    def compile_once(signature: Any) -> Any:
        log.debug("needs %s", function.__qualname__)
        if files.has(signature, dispatcher.targetctx):
            return compile_here(signature)
        directory = _cache_directory()
        with _alone(os.path.join(directory, f"{name}.lock"), function.__qualname__):
            return compile_here(signature)

    dispatcher.compile = compile_once


def _borrow(dispatcher: Any) -> None:
    """Refuse to compile a function that counts no references and returns an array: its caller would give back what it
    was never given.
    """
    compile_here = dispatcher.compile

    def compile_checked(signature: Any) -> Any:
        found = compile_here(signature)
        returned = dispatcher.targetctx.data_model_manager[dispatcher.overloads[signature].signature.return_type]
        if returned.contains_nrt_meminfo():
            raise TypeError(f"{dispatcher.py_func.__qualname__} is inline and returns an array: make it a kernel")
        return found

    dispatcher.compile = compile_checked


class Inline:
    """A function that is compiled into its callers; from Python it stays the plain function.

    It borrows the arrays that it is given: it neither makes nor returns any, and counts no references to them. In a
    kernel numba counts those of every array of a named tuple at each call, in atomic steps of some nanoseconds.
    """

    def __init__(self, function: Callable[..., Any], *, forced: bool = True) -> None:
        """Inside other kernels it needs neither a wrapper nor a file, and is compiled once, whoever calls it."""
        update_wrapper(self, function)
        self._run = function
        options: dict[str, Any] = _INSIDE | {"forceinline": forced, "_nrt": not forced}
        self._inside = numba.njit(pipeline_class=_InsideCompiler, **options)(function)
        if forced:
            _borrow(self._inside)

    def __call__(self, *arguments: Any) -> Any:
        return self._run(*arguments)

    @property
    def _numba_type_(self) -> Any:  # what numba asks an object for
        return self._inside._numba_type_


class Kernel(Inline):
    """A compiled function with an entry from Python, which is kept on disk; inside other kernels it has none."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function, forced=False)
        self._entry = numba.njit(nogil=True, forceinline=False, pipeline_class=_EntryCompiler, **_OPTIONS)(function)
        _share(self._entry)
        self._run = self._first

    def compiled(self, kinds: tuple[Any, ...]) -> Any:
        """What numba has of it for arguments of these types, compiled or loaded."""
        with _seldom_collected:
            _with_room(self._entry.compile, kinds)
        return self._entry.overloads[kinds]

    def _first(self, *arguments: Any) -> Any:
        self._run = self._entry
        with _seldom_collected:
            return _with_room(self._entry, *arguments)


def for_type(function: Callable[..., Any], kind: type) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Say what a function is, inside kernels, whose last argument is a named tuple of this kind: the decorated one."""

    def register(implementation: Callable[..., Any]) -> Callable[..., Any]:
        def choose(*arguments: Any) -> Any:
            return implementation if getattr(arguments[-1], "instance_class", None) is kind else None

        chooser: Any = choose
        chooser.__signature__ = inspect.signature(implementation)  # numba matches arguments by their names
        options: Any = {"forceinline": False, **_INSIDE}
        overload(function, strict=False, jit_options=options)(chooser)
        return implementation

    return register


def kernel(function: Callable[..., Any]) -> Kernel:
    """Compile a kernel on first call, and cache it on disk; other threads run meanwhile."""
    return Kernel(function)


def inline(function: Callable[..., Any]) -> Inline:
    """Compile a small function into its callers: a loop over it stays one straight line, which LLVM vectorises."""
    return Inline(function)
