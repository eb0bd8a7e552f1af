"""Lines and branches of the packages that the tests run, of this checkout: `make coverage`.

Prints, package by package, how many there are and how many of them ran, beside what pytest says; what runs compiled is
not seen. Arguments are pytest's. With --beside FILE what another run wrote to build/coverage/counts.json is shown too.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "build" / "coverage"
PACKAGES = ("rattle", "workers", "service")
SUITE = ["-m", "pytest", "-n", "auto", "--no-loadscope-reorder"]
COUNTED = ("num_statements", "covered_lines", "num_branches", "covered_branches")


def tool(*arguments: str) -> int:
    """Run coverage in the checkout."""
    command = [sys.executable, "-m", "coverage", *arguments]
    settings = {"COVERAGE_RCFILE": str(ROOT / "tests" / "coverage.ini")}
    return subprocess.run(command, cwd=ROOT, check=False, env=os.environ | settings).returncode


def counts() -> dict[str, dict[str, int]]:
    """Return by package the numbers of statements, of those that ran, of branches, and of those taken."""
    files = json.loads((KEPT / "files.json").read_text())["files"]
    here = {name: [each["summary"] for path, each in files.items() if Path(path).parts[0] == name] for name in PACKAGES}
    return {name: {key: sum(each[key] for each in found) for key in COUNTED} for name, found in here.items()}


def row(found: dict[str, int]) -> str:
    """Return both shares as text."""
    lines, branches = (100.0 * found[ran] / max(found[of], 1) for of, ran in (COUNTED[:2], COUNTED[2:]))
    return f"{lines:6.2f} % of {found['num_statements']} lines, {branches:6.2f} % of {found['num_branches']} branches"


def main() -> int:
    """Run the tests with coverage, print the shares, and return pytest's exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--beside", type=Path, help="counts of another run")
    known, further = parser.parse_known_args()
    KEPT.mkdir(parents=True, exist_ok=True)
    for old in KEPT.glob("data*"):
        old.unlink()
    ended = tool("run", *SUITE, *further)
    tool("combine", "--quiet")
    tool("json", "--quiet", "-o", str(KEPT / "files.json"))
    found = counts()
    (KEPT / "counts.json").write_text(json.dumps(found, indent=1) + "\n")
    other = json.loads(known.beside.read_text()) if known.beside else {}
    for name, each in found.items():
        print(f"{name:8} {row(each)}" + (f"; before {row(other[name])}" if name in other else ""))
    return ended


if __name__ == "__main__":
    sys.exit(main())
