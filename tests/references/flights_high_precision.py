"""First impacts in 40 digits, kept in tests/reference."""

from high_precision import Flight
from stored import stored


@stored
def first_impact(wall, phase, velocity, delta, epsilon, beta):
    """(time, wall, velocity) of the first impact after a departure."""
    return Flight(wall, phase, velocity, delta, epsilon, beta).first_impact()
