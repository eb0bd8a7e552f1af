"""Measure the cost of a cell in several versions of this repository: `python benchmarks/versions.py DIRECTORY …`.

Each directory is a checkout, for example from `git worktree add DIRECTORY COMMIT`. The cells are those of `make bench
MEASURED=survey`. The program prints JSON: for each class the least milliseconds of processor time per cell in several
runs, and the impacts on Σ⁺ per cell.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys

from bench.cells import BETA, COUNT, NAMES, TURNS, V_MAX, WHOLE, classes

from rattle import toolchain

ANSWER = f"""
import json, sys, time
import numpy as np
import rattle
print(rattle.__file__, file=sys.stderr)
for line in sys.stdin:
    delta, epsilon = (np.array(x) for x in json.loads(line))
    began = time.thread_time()
    found = rattle.attractors_of(delta, epsilon, {BETA}, {COUNT}, {V_MAX}, 0)
    seconds = time.thread_time() - began
    print(json.dumps([seconds / delta.size * 1e3, int(found.impacts.sum()) / delta.size]), flush=True)
"""


def main(directories: list[str]) -> None:
    """Measure the versions in some directories, and print the costs."""
    sampled = classes()
    lines = [json.dumps([each.delta.tolist(), each.epsilon.tolist()]) for each in sampled]
    versions = {directory: _started(directory) for directory in dict.fromkeys(directories)}
    turns = [
        {name: [_asked(child, line) for line in lines] for name, child in versions.items()} for _ in range(TURNS + 1)
    ]
    shares = [each.share for each in sampled]
    for name in versions:
        least = [min(turn[name][i] for turn in turns[1:]) for i in range(len(NAMES))]  # the first run may compile
        mean = [sum(share * cost[i] for share, cost in zip(shares, least, strict=True)) for i in range(2)]
        print(json.dumps({name: dict(zip(NAMES, least, strict=True)) | {WHOLE: mean}}, indent=1))
    print(toolchain()["processor"])
    for child in versions.values():
        child.communicate()


def _started(directory: str) -> subprocess.Popen[str]:
    pipe, environment = subprocess.PIPE, os.environ | {"PYTHONPATH": directory}
    command = [sys.executable, "-P", "-c", ANSWER]
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=environment, cwd=directory)


def _asked(child: subprocess.Popen[str], line: str) -> list[float]:
    assert child.stdin is not None
    assert child.stdout is not None
    child.stdin.write(line + "\n")
    child.stdin.flush()
    answer: list[float] = json.loads(child.stdout.readline())
    return answer


if __name__ == "__main__":
    main(sys.argv[1:])
