"""The whole suite while others keep the processors busy, and on one core: `make test-under-load`.

No verdict may depend on speed. Prints each run's count and seconds, and what failed in it.
"""

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
SUITE = [sys.executable, "-m", "pytest", "-n", "auto", "--no-loadscope-reorder"]
BUSY = "while True: pass"


@contextmanager
def busy(programs: int) -> Iterator[None]:
    """Programs at normal priority that never rest."""
    running = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(programs)]
    try:
        yield
    finally:
        for program in running:
            program.kill()
            program.wait()


def run(name: str, cores: set[int], further: list[str]) -> bool:
    """Run the suite on these cores, and say how it ended."""
    began = time.monotonic()
    suite = subprocess.run(
        [*SUITE, *further],
        cwd=ROOT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=lambda: os.sched_setaffinity(0, cores),
    )
    lines = suite.stdout.splitlines()
    failed = [line for line in lines if re.match(r"(FAILED|ERROR) ", line)]
    print(f"{name}: {lines[-1].strip('= ') if lines else 'nothing'} ({time.monotonic() - began:.0f} s)", flush=True)
    for line in failed or ([] if suite.returncode == 0 else lines[-40:]):
        print(f"  {line}", flush=True)
    return suite.returncode == 0


def main() -> int:
    """Run as asked; 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=3, help="of the suite beside busy programs")
    parser.add_argument("--programs", type=int, default=os.cpu_count() or 2, help="that keep the cores busy")
    parser.add_argument("--skip-one-core", action="store_true", help="leave out the run on one core")
    known, further = parser.parse_known_args()  # what is left is pytest's
    everywhere = os.sched_getaffinity(0)
    passed = True
    with busy(known.programs):
        for number in range(known.runs):
            passed &= run(f"beside {known.programs} busy programs, {number + 1} of {known.runs}", everywhere, further)
    if not known.skip_one_core:
        passed &= run("on one core", {min(everywhere)}, further)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
