"""Compute tests/reference/high_precision.json anew: all that the tests ask of the oracles, which takes minutes.

    python tests/references/make_references.py [--add]

With --add only what is not there yet. Other places, of CURVES_SEED=N, belong to a run and not into the file.
"""

import os
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
ASKING = (
    "proof_motions",
    "rattle_branches",
    "rattle_curves",
    "rattle_flight",
    "rattle_stable_orbits",
    "rattle_trajectory",
    "workers_deep_zoom",
)

if __name__ == "__main__":
    sys.path[:0] = [str(TESTS.parent), str(TESTS / "references")]
    os.environ["TEST_DEPTH"] = "deep"

    import pytest
    import stored

    if "--add" not in sys.argv:
        stored.KEPT.clear()
    code = pytest.main(["-q", *(str(path) for name in ASKING for path in (TESTS / "oracles").rglob(f"test_{name}.py"))])
    if code == 0:
        stored.write()
    sys.exit(code)
