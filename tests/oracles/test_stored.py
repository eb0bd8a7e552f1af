"""Stored answers of the oracles are what the oracles answer: a random tenth, or with TEST_DEPTH=deep all.

REFERENCE_SEED=N takes another tenth.
"""

import json
import os
import sys

import curves_high_precision
import flights_high_precision
import motions_high_precision
import numpy as np
import pytest
from depth import DEEP
from mpmath import mpf
from stored import KEPT, ORACLES, plain, read

SEED = int(os.environ.get("REFERENCE_SEED", 2009))
SHARE = 10
MODULES = (curves_high_precision, flights_high_precision, motions_high_precision)


def some(name):
    """The questions to an oracle that are asked again, those first that come first."""
    asked = sorted(KEPT[name])
    rng = np.random.default_rng([SEED, *name.encode()])
    return asked if DEEP else sorted(rng.choice(asked, -(-len(asked) // SHARE), replace=False).tolist())


def same(one, other):
    """Numbers agree to sixteen digits, of which a double multiplier costs half of forty; all else entirely."""
    if isinstance(one, list):
        return len(one) == len(other) and all(same(x, y) for x, y in zip(one, other, strict=True))
    if isinstance(one, (str, bool, int, type(None))):
        return one == other
    return abs(one - other) <= mpf(10) ** -16 * (1 + abs(one))


def test_every_oracle_is_stored():
    assert {name for name, oracle in ORACLES.items() if sys.modules[oracle.__module__] in MODULES} == set(KEPT)


@pytest.mark.parametrize("name", sorted(KEPT))
def test_stored_answers_are_those_of_the_oracle(name):
    for asked in some(name):
        again = read(plain(ORACLES[name](*read(json.loads(asked)))))
        assert same(read(KEPT[name][asked]), again), (name, asked)
