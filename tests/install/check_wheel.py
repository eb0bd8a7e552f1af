"""The wheel as users install it: built, put into clean environments outside the checkout, and used (`inside.py`).

It uses, for every Python of ``PYTHONS`` that is installed, the newest release of every dependency and the lowest that
pyproject.toml names, or one of these (`check_wheel.py lowest`). It needs uv, which keeps what it downloads in cache.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PYTHONS = ("3.11", "3.12", "3.13")
RESOLUTIONS = {"newest": "highest", "lowest": "lowest-direct"}
SERVICE = ("plot", "workers", "cli", "service")  # the extras that the service holds
PACKAGES = ("rattle", "workers", "service", "gear_rattle")
FOREIGN = ("service", "workers")  # that other people may have, too
DOCUMENTS = (
    "README.md",
    "LICENSE",
    "CHANGELOG.md",
    "CITATION.cff",
    "CODE_OF_CONDUCT.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
)
CACHE = Path.home() / ".cache" / "gear-rattle-install"
HANG = 900  # seconds: nothing takes as long unless it hangs
#: What the lines name: where versions differ most, and what broke before.
NAMED = ("numpy", "numba", "zarr", "xarray", "dask", "fastapi", "starlette", "sqlalchemy", "panel", "bokeh")


class FailedError(Exception):
    """A command of an environment failed; what it printed."""


@dataclass(frozen=True)
class Environment:
    """One Python with one set of releases, in a directory of its own."""

    python: str
    interpreter: Path
    which: str
    where: Path

    def check(self, uv: str, wheel: Path) -> str:
        """Install the wheel and use it; the line that says so.

        Raises FailedError.
        """
        began = time.monotonic()
        bin_ = self.where / "venv" / "bin"
        python = str(bin_ / "python")
        self._run(uv, "venv", "--quiet", "--no-project", "--python", str(self.interpreter), str(bin_.parent))
        resolution = RESOLUTIONS[self.which]
        self._run(
            *(uv, "pip", "install", "--quiet", "--no-config", "--python", python),
            *("--only-binary", ":all:", "--resolution", resolution, f"gear-rattle[service] @ {wheel.as_uri()}"),
            # What the wheel asks for is asked for directly: only of that uv takes the lowest.
            *("--requirements", str(ROOT / "pyproject.toml"), "--extra", "service"),
        )
        installed = time.monotonic()
        listed = self._run(uv, "pip", "freeze", "--quiet", "--python", python)
        versions = dict(re.findall(r"^([\w.-]+)==(\S+)$", listed, re.M))
        if self.which == "lowest":
            self._require_lowest(versions)
        self._put_foreign_packages(python)
        inside = shutil.copy(Path(__file__).with_name("inside.py"), self.where)
        said = self._run(python, "-I", "-u", "-X", f"pycache_prefix={self._bytecode}", str(inside), str(ROOT))
        named = ", ".join(f"{name} {versions[name]}" for name in NAMED if name in versions)
        return (
            f"Python {self.python}, {self.which}: {installed - began:.0f} s to install {len(versions) + 1} packages, "
            f"{time.monotonic() - installed:.0f} s ({said.splitlines()[-1]}) to use them: {named}"
        )

    @property
    def _bytecode(self) -> Path:
        return CACHE / "bytecode" / self.where.name

    def _put_foreign_packages(self, python: str) -> None:
        """Other people's packages of the names that ours have in the checkout; `inside.py` imports both."""
        library = Path(self._run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
        for name in FOREIGN:
            (library / name).mkdir()
            (library / name / "__init__.py").write_text("WHOSE = 'somebody else'\n")

    def _require_lowest(self, versions: dict[str, str]) -> None:
        """The bounds of pyproject.toml are releases that exist, and were installed."""
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
        extras = project["optional-dependencies"]
        asked = project["dependencies"] + [each for name in SERVICE for each in extras[name]]
        for requirement in map(Requirement, asked):
            found = versions.get(requirement.name)
            if found is None or (
                requirement.marker and not requirement.marker.evaluate({"python_version": self.python})
            ):
                continue
            (bound,) = [each.version for each in requirement.specifier if each.operator == ">="]
            if found != bound and not found.startswith(f"{bound}."):
                raise FailedError(f"{requirement.name} {found} was installed as the lowest, not {bound}")

    def _run(self, *command: str) -> str:
        """Return the output of a command in this environment, without the checkout or other environments."""
        home = self.where / "home"
        home.mkdir(parents=True, exist_ok=True)
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "RATTLE_", "VIRT"))}
        cache = os.environ.get("UV_CACHE_DIR") or str(Path.home() / ".cache" / "uv")
        environment = {
            **kept,
            "HOME": str(home),
            "XDG_CACHE_HOME": str(home / ".cache"),
            # Downloads, bytecode, and kernels of the same code and releases: what another run of this made.
            "RATTLE_CACHE_DIR": os.environ.get("RATTLE_CACHE_DIR") or str(Path.home() / ".cache" / "rattle"),
            "UV_CACHE_DIR": cache,
            "PYTHONPYCACHEPREFIX": str(self._bytecode),
        }
        try:
            return subprocess.run(
                command, cwd=self.where, env=environment, text=True, timeout=HANG, check=True,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            ).stdout  # fmt: skip
        except subprocess.CalledProcessError as error:
            raise FailedError(f"{' '.join(command)}\n{error.stdout}") from error
        except subprocess.TimeoutExpired as error:
            said = (error.stdout or b"").decode() if isinstance(error.stdout, bytes) else error.stdout or ""
            raise FailedError(f"{' '.join(command)} hangs\n{said}") from error


def interpreters() -> dict[str, Path]:
    """Return the path of each Python that runs here; a shim of pyenv may exist without one."""
    found: dict[str, Path] = {}
    for version in PYTHONS:
        for candidate in _candidates(version):
            said = subprocess.run(
                [candidate, "-c", "import sys, venv; print('%d.%d' % sys.version_info[:2])"],
                capture_output=True, text=True, check=False,
            )  # fmt: skip
            if said.returncode == 0 and said.stdout.strip() == version:
                found[version] = Path(candidate)
                break
    return found


def _candidates(version: str) -> Iterator[str]:
    if f"{sys.version_info.major}.{sys.version_info.minor}" == version:
        yield sys.executable
    if on_path := shutil.which(f"python{version}"):
        yield on_path
        # A shim of pyenv finds no version in an empty HOME; they are beside it.
        yield from map(str, sorted(Path(on_path).parents[1].glob(f"versions/{version}.*/bin/python")))
    yield from map(str, sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python")))


def main() -> int:
    """Check everything; the exit code says whether all is well."""
    uv = shutil.which("uv", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
    if uv is None:
        sys.exit("uv is not there: pip install uv")
    began = time.monotonic()
    pythons = interpreters()
    absent = [version for version in PYTHONS if version not in pythons]
    failures = 0
    with _directory() as top, _one_for_each_processor() as pool:
        wheel = build(top)
        jobs = {}
        for which in sys.argv[1:] or RESOLUTIONS:
            for version, interpreter in pythons.items():
                where = top / f"{version}-{which}"
                where.mkdir()
                jobs[pool.submit(Environment(version, interpreter, which, where).check, uv, wheel)] = (version, which)
        for job in as_completed(jobs):
            try:
                print(job.result(), flush=True)
            except Exception as error:
                failures += 1
                version, which = jobs[job]
                print(f"FAILED: Python {version}, {which}: {error}", flush=True)
    for version in absent:
        print(f"Python {version} is not installed: not checked")
    print(f"{len(jobs) - failures} passed, {failures} failed in {time.monotonic() - began:.0f} s")
    return 1 if failures or not jobs else 0


@contextmanager
def _directory() -> Iterator[Path]:
    """Somewhere outside the checkout: where the last run was, because bytecode is kept by the path of its source, or
    another run is there now.
    """
    with tempfile.TemporaryDirectory(prefix="gear-rattle-") as temporary:
        CACHE.mkdir(parents=True, exist_ok=True)
        with (CACHE / "lock").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                yield Path(temporary)
                return
            top = CACHE / "environments"
            shutil.rmtree(top, ignore_errors=True)  # of a run that was killed
            top.mkdir()
            yield top
            shutil.rmtree(top)


def _one_for_each_processor() -> ThreadPoolExecutor:
    """Threads whose processes stay on one processor each: while all are busy, to compile on two is only more work."""
    free = [*os.sched_getaffinity(0)]
    return ThreadPoolExecutor(len(free), initializer=lambda: os.sched_setaffinity(0, {free.pop()}))


def build(top: Path) -> Path:
    """The wheel of the checkout, of its source distribution; from a copy: setuptools leaves files where it builds.

    Raises FailedError: either is not what an index takes, or puts other names into a user's site-packages.
    """
    source, made = top / "source", top / "dist"
    source.mkdir()
    for name in (*DOCUMENTS, "pyproject.toml", "MANIFEST.in", "constraints.txt"):
        shutil.copy(ROOT / name, source)
    for package in (*PACKAGES, "docs"):
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"), symlinks=True)
    _made(sys.executable, "-m", "build", "--installer", "uv", "--outdir", str(made), str(source))
    _made(sys.executable, "-m", "twine", "check", "--strict", *map(str, made.iterdir()))
    shutil.rmtree(source)
    (wheel,) = made.glob("*.whl")
    with ZipFile(wheel) as files:
        names = {name.partition("/")[0] for name in files.namelist()}
        notes = {name for name in names if name.endswith(".dist-info")}
        if names - notes != {"rattle", "gear_rattle"} or "rattle/py.typed" not in files.namelist():
            raise FailedError(f"{wheel.name} holds {', '.join(sorted(names))}")
    return wheel


def _made(*command: str) -> None:
    done = subprocess.run(
        command, timeout=HANG, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    if done.returncode:
        raise FailedError(f"{' '.join(command)}\n{done.stdout}")


if __name__ == "__main__":
    sys.exit(main())
