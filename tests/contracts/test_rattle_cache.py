"""Compiled kernels are found again by the next process."""

import subprocess
import sys
from pathlib import Path

from rattle._compile import _cache_directory


def warm_up() -> set[Path]:
    subprocess.run([sys.executable, "-c", "import rattle; rattle.warm_up()"], check=True)
    return set(Path(_cache_directory()).rglob("*.nbc"))


def test_a_second_process_compiles_nothing() -> None:
    first = warm_up()
    assert first
    assert warm_up() == first
