"""The side of the boundary crisis: against its solved ε, and against long simulation."""

import numpy as np
import pytest
from depth import deep

import rattle

# `rattle.crisis.boundary_crisis` at β = 0.6, itself tested where it belongs
CRISES = {0.6: 0.1108867568417, 0.65: 0.103495957814, 0.7: 0.098709207457, 0.762: 0.0974223469577094}
NO_SADDLE, INSIDE, ESCAPES, UNDECIDED = range(1, 5)


@pytest.mark.parametrize(("delta", "epsilon"), CRISES.items())
def test_both_sides_of_the_solved_crisis(delta, epsilon):
    shift = np.array([-1e-3, -1e-4, -1e-5, 1e-5, 1e-4, 1e-3])
    assert rattle.crisis_side(delta, epsilon + shift).tolist() == [INSIDE] * 3 + [ESCAPES] * 3


def share_at_rest(delta, epsilon, beta):
    """Return the share of states just outside A, towards rising v, that are at rest after 30 000 impacts."""
    gear = rattle.Gear(delta, epsilon, beta)
    a = gear.orbits()[0]
    x = np.random.default_rng(7).random((2, 400))
    end = gear.iterate(a.tau + 2e-4 * (x[0] - 0.5), a.v + 0.01 * (0.5 + x[1]), 30_000)
    return np.mean(end.v < 0.05 * a.v)


@pytest.mark.parametrize(
    ("point", "side"),
    [
        ((0.6, 0.1, 0.6), INSIDE),
        ((0.6, 0.12, 0.6), ESCAPES),
        ((0.45, 0.08, 0.3), ESCAPES),
        pytest.param((0.35, 0.05, 0.3), ESCAPES, marks=deep),
        ((0.6, 0.12, 1.2), INSIDE),
        pytest.param((0.45, 0.05, 0.6), INSIDE, marks=deep),
    ],
)
def test_simulation_agrees(point, side):
    assert rattle.crisis_side(*point) == side
    assert (share_at_rest(*point) > 0) == (side == ESCAPES)


def test_what_cannot_be_told():
    assert rattle.crisis_side(0.6, 0.05) == NO_SADDLE
    above = rattle.Gear(0.5, 0.17)
    assert above.epsilon > above.quiet_limit
    assert rattle.crisis_side(above.delta, above.epsilon) in (NO_SADDLE, UNDECIDED)
    assert rattle.crisis_side(0.6, rattle.sn1(0.6) * (1 + 1e-9)) in (NO_SADDLE, UNDECIDED)
    assert rattle.crisis_side([0.6, 0.65], [[0.05], [0.1], [0.11]]).shape == (3, 2)
    with pytest.raises(rattle.ParameterError):
        rattle.crisis_side(0.0, 0.1)
