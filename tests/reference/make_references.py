"""Compute high_precision.json anew: all that the tests ask of the oracles, which takes minutes.

    python tests/reference/make_references.py [--add]

With --add only what is not there yet. Other places, of CURVES_SEED=N, belong to a run and not into the file.
"""

import os
import sys
from pathlib import Path

TESTS = Path(__file__).parents[1]
ASKING = ("rattle_branches", "rattle_curves", "rattle_flight", "rattle_trajectory", "workers_deep_zoom")

if __name__ == "__main__":
    sys.path[:0] = [str(TESTS.parent), str(TESTS / "oracles")]
    os.environ["TEST_DEPTH"] = "deep"

    import pytest
    import stored

    if "--add" not in sys.argv:
        stored.KEPT.clear()
    code = pytest.main(["-q", *(str(TESTS / "oracles" / f"test_{name}.py") for name in ASKING)])
    if code == 0:
        stored.write()
    sys.exit(code)
