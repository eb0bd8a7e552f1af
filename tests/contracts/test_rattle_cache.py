"""Compiled kernels are found again by the next process."""

import shutil
import subprocess
import sys
from pathlib import Path

import rattle
from rattle._compile import _cache_directory


def warm_up() -> set[Path]:
    subprocess.run([sys.executable, "-c", "import rattle; rattle.warm_up()"], check=True)
    return set(Path(_cache_directory()).rglob("*.nbc"))


def test_a_second_process_compiles_nothing() -> None:
    first = warm_up()
    assert first
    assert warm_up() == first


def test_only_modules_that_compute_decide_which_version_it_is(tmp_path: Path) -> None:
    package = tmp_path / "rattle"
    shutil.copytree(Path(rattle.__file__).parent, package)

    def version() -> str:
        command = [sys.executable, "-c", "from rattle._compile import source_hash; print(source_hash())"]
        return subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout

    before = version()
    (package / "plot" / "colours.py").write_text("changed = True\n")
    assert version() == before
    (package / "curves" / "new.py").write_text("changed = True\n")
    assert version() != before
