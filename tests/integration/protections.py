"""Take out the protections of `mutations.py` one by one, in a copy of the project, and run their tests: each must fail.

    python tests/integration/protections.py [WORD …]

takes minutes. Only protections whose name contains one of the words are taken out. The tests run first with every
protection in place, and must pass, because a test that always fails shows nothing. The quick test `test_protections.py`
checks that every protection can still be taken out.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path

from mutations import PROTECTIONS, Protection

ROOT = Path(__file__).parents[2]
COPY = ROOT / "build" / "protections"  # the same in every run: compiled kernels are found again by their place
LEFT_OUT = shutil.ignore_patterns(".*", "build", "node_modules", "__pycache__", "*.egg-info")
S3 = ".venv-s3"  # the bucket of the tests
SECONDS = 150


def _tail(output: str) -> str:
    errors = [line for line in output.splitlines() if line.startswith("E  ")]
    return (errors or output.splitlines() or ["nothing was said"])[0].removeprefix("E").strip()[:160]


def copy_project(copy: Path) -> None:
    """Copy the project, and compile its kernels there unless an earlier run did, so that no test waits for them."""
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(ROOT, copy, symlinks=True, ignore=LEFT_OUT)
    (copy / S3).symlink_to(ROOT / S3)
    compile_kernels = "from gear_rattle.service.kernels import compile_kernels; compile_kernels('impacting')"
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
        told = _run([protection.test], copy, "-x")
    finally:
        for file, text in whole.items():
            (copy / file).write_text(text)
    seconds, said = time.monotonic() - began, _tail(told.stdout)
    failed = told.returncode == 1  # 0: it passed; any other status: it did not run
    if failed and "Timeout" in said:
        failed = _run([protection.test], copy).returncode == 0
        said = "hangs" if failed else "slow, also with the protection: try it on an idle machine"
    print(f"{'failed' if failed else 'NOT SEEN'} {seconds:4.0f} s  {protection.name}: {said}", flush=True)
    return failed


def _run(tests: Iterable[str], copy: Path, *more: str) -> subprocess.CompletedProcess[str]:
    # Without percentages: "E   [100%]", an error of a fixture, would be taken for a line of its traceback.
    options = [*more, "-q", f"--timeout={SECONDS}", "-p", "no:cacheprovider", "-o", "console_output_style=classic"]
    command = [sys.executable, "-m", "pytest", *options, *tests]
    return subprocess.run(command, cwd=copy, env=_environment(copy), capture_output=True, text=True)


def pass_as_they_are(chosen: Iterable[Protection], copy: Path) -> bool:
    """Return whether their tests pass with every protection in its place, and print what did not."""
    told = _run(sorted({protection.test for protection in chosen}), copy)
    print(told.stdout if told.returncode else told.stdout.splitlines()[-1], flush=True)
    return told.returncode == 0


def main() -> None:
    words = sys.argv[1:]
    chosen = [each for each in PROTECTIONS if not words or any(word in each.name for word in words)]
    copy_project(COPY)
    results = [bool(chosen) and pass_as_they_are(chosen, COPY), *(try_out(protection, COPY) for protection in chosen)]
    sys.exit(0 if all(results) else 1)


if __name__ == "__main__":
    main()
