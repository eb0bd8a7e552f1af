"""Where the time of cells goes: a clock in the kernels changes no bit, and its parts are the whole."""

import numpy as np
from depth import deep

import rattle
from rattle.flight.lanes.block import GROUP
from rattle.impacting.attractors.classifier import cells_of
from rattle.impacting.attractors.settle import LONG_CHUNK
from rattle.impacting.attractors.timed import FLOWN, OFFERED, TimedClassifier, timed_attractors
from rattle.impacting.map.iterate import iterate
from rattle.numerics.sampling import initial_conditions

#: Quiet alone, five attractors, chaos beside quiet, chaos alone: witnesses are watched in the last two.
DELTA, EPSILON = np.full(4, 0.6), np.array([0.056, 0.089, 0.1, 0.25])


@deep  # compiles both kernels once more
def test_a_clock_changes_nothing_and_its_parts_are_the_whole() -> None:
    table, parts = timed_attractors(DELTA, EPSILON, 0.6, 16, 7.0)
    plain = rattle.attractors_of(DELTA, EPSILON, 0.6, 16, 7.0, 0)
    for field, x, y in zip(plain._fields, table, plain, strict=True):
        np.testing.assert_array_equal(x, y, field)
    assert min(parts) >= 0
    assert min(parts.flights, parts.looks, parts.idle, parts.newton, parts.rest) > 0


@deep
def test_flights_are_counted_as_they_are_flown() -> None:
    """One sample, which the map flies as far in one go; the other lanes of its group have none."""
    delta, epsilon, beta = np.array([0.6]), np.array([0.25]), np.array([0.6])
    tau, v = initial_conditions(delta, epsilon, beta, 1, np.array([7.0]), 0)
    found = TimedClassifier(cells_of(delta, epsilon, beta), tau.copy(), v.copy())
    found.advance(np.zeros(1, np.int64), found.samples, early=False)
    made = iterate(delta, epsilon, tau[0], v[0], found.samples.impacts, beta)
    meter = found._meters[0]
    assert found.samples.impacts[0] == 64
    assert meter[FLOWN] == made.n_plus[0] + made.n_minus[0]
    assert meter[OFFERED] == GROUP * LONG_CHUNK * -(-meter[FLOWN] // LONG_CHUNK)


@deep
def test_parts_add_up_to_the_seconds_that_were_taken() -> None:
    tau, v = initial_conditions(DELTA, EPSILON, np.full(4, 0.6), 16, np.full(4, 7.0), 0)
    found = TimedClassifier(cells_of(DELTA, EPSILON, np.full(4, 0.6)), tau, v)
    found.run()
    np.testing.assert_allclose(sum(found.parts(10.0)), 10.0, rtol=1e-12)
    assert (found._meters[:, FLOWN] <= found._meters[:, OFFERED]).all()
    assert 0 <= found.tangent_share() < 1
