"""The derived change of speed in a small bounce, in 40 digits from the equations of motion alone."""

import numpy as np
import pytest
from high_precision import Flight, _root
from mpmath import mpf

from rattle.paper import formulas


@pytest.mark.parametrize(("delta", "epsilon"), [(0.6, 0.1), (0.4, 0.05), (1.0, 0.2)])
@pytest.mark.parametrize("phase", [0.0, 0.13, 0.4, 0.77])
def test_a_third_of_the_printed_coefficient(delta, epsilon, phase):
    v = mpf(10) ** -8
    flight = Flight(1, phase, -v, delta, epsilon, 0.6)
    at = np.array(phase)
    first = 2 * v / mpf(float(formulas.acceleration_by_formula(at, 0.0, delta, epsilon)))
    time = _root(lambda s: (flight.position(s) - flight.beta) / s, first * mpf("0.99"), first * mpf("1.01"))
    assert float(time / first) == pytest.approx(1, abs=1e-6)
    coefficient = float((flight.velocity(time) - v) / v**2)
    printed = float(formulas.f(at, 0.0, delta, epsilon) / formulas.g(at, 0.0, delta, epsilon))
    assert coefficient == pytest.approx(printed / 3, rel=1e-6)
