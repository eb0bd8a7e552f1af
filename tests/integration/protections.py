"""Take out the protections of `mutations.py` one by one, in a copy of the project, and run their tests: each must fail.

    python tests/integration/protections.py [WORD …]

takes minutes. Only protections whose name contains one of the words are taken out. The quick test `test_protections.py`
checks that every protection can still be taken out.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mutations import PROTECTIONS, Protection

ROOT = Path(__file__).parents[2]
COPIED = ("rattle", "gear_rattle", "workers", "service", "tests", "pyproject.toml", "docker-compose.yml")
SECONDS = 150


def _tail(output: str) -> str:
    errors = [line for line in output.splitlines() if line.startswith("E  ")]
    return (errors or output.splitlines() or ["nothing was said"])[0].removeprefix("E").strip()[:160]


def copy_project(copy: Path) -> None:
    """Copy the project, and compile its kernels there, so that no test waits for them."""
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, copy / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(source, copy / name)
    compile_kernels = "import rattle; rattle.precompile()"
    subprocess.run([sys.executable, "-c", compile_kernels], cwd=copy, env=_environment(copy), check=True)


def _environment(copy: Path) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(copy)}


def try_out(protection: Protection, copy: Path) -> bool:
    """Return whether the test fails without the protection, and print how; with it, a hanging test must end in time."""
    whole = {edit.file: (copy / edit.file).read_text() for edit in protection.edits}
    began = time.monotonic()
    try:
        for edit in protection.edits:
            edit.apply(copy)
        told = _run(protection.test, copy)
    finally:
        for file, text in whole.items():
            (copy / file).write_text(text)
    seconds, said = time.monotonic() - began, _tail(told.stdout)
    failed = told.returncode == 1  # 0: it passed; any other status: it did not run
    if failed and "Timeout" in said:
        failed = _run(protection.test, copy).returncode == 0
        said = "hangs" if failed else "slow, also with the protection: try it on an idle machine"
    print(f"{'failed' if failed else 'NOT SEEN'} {seconds:4.0f} s  {protection.name}: {said}", flush=True)
    return failed


def _run(test: str, copy: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", "-x", "-q", f"--timeout={SECONDS}", "-p", "no:cacheprovider"]
    return subprocess.run([*command, *test.split()], cwd=copy, env=_environment(copy), capture_output=True, text=True)


def main() -> None:
    words = sys.argv[1:]
    chosen = [each for each in PROTECTIONS if not words or any(word in each.name for word in words)]
    with tempfile.TemporaryDirectory() as directory:
        copy_project(Path(directory))
        results = [try_out(protection, Path(directory)) for protection in chosen]
    sys.exit(0 if results and all(results) else 1)


if __name__ == "__main__":
    main()
