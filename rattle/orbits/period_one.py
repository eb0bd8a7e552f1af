"""The period-one motions A to D as any gear has them, and the regions of the plane that they make."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

NAMES = ("A", "B", "C", "D")
N_MINUS = (0, 1, 0, 1)


class Orbit(NamedTuple):
    """A period-one orbit P(m, n_plus, n_minus) of the impact map, at one of its impacts on Σ⁺.

    tau is the phase in [0, 1), v > 0 the speed after impact (units: gap coordinate per forcing period), multipliers
    the two Floquet multipliers over m forcing periods (complex, product e^(−δm)).
    """

    name: str
    m: int
    n_plus: int
    n_minus: int
    tau: float
    v: float
    multipliers: tuple[complex, complex]
    stable: bool


class PeriodOne(NamedTuple):
    """Orbits A, B, C, D over arrays of parameters of shape S: (4, *S), multipliers (4, 2, *S); NaN where absent."""

    exists: NDArray[np.bool_]
    stable: NDArray[np.bool_]
    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    multipliers: NDArray[np.complex128]


def multipliers_of(trace: ArrayLike, determinant: ArrayLike) -> NDArray[np.complex128]:
    """Both roots of λ² − trace λ + determinant, the larger modulus first, along a new first axis; no cancellation."""
    t, d = np.broadcast_arrays(np.asarray(trace, np.float64), np.asarray(determinant, np.float64))
    root = np.sqrt((t * t / 4 - d).astype(np.complex128))
    large = t / 2 + np.where(t < 0, -root, root)
    with np.errstate(divide="ignore", invalid="ignore"):
        small = np.where(root.imag != 0, np.conj(large), d / large)
    return np.stack([large, small])


OTHER, REGION_I, REGION_II, REGION_III, REGION_IV, REGION_V = range(6)


def classify(orbits: PeriodOne) -> NDArray[np.int8]:
    """Region of each parameter point from its period-one orbits; 0 where the combination is none of the five.

    I: none of A–D. II: A and C. III: all four, D stable. IV: all four, D unstable. V: A and D.
    """
    a, b, c, d = orbits.exists
    stable = orbits.stable[3]
    region = np.full(a.shape, OTHER, np.int8)
    region[~(a | b | c | d)] = REGION_I
    region[a & c & ~b & ~d] = REGION_II
    region[a & b & c & d & stable] = REGION_III
    region[a & b & c & d & ~stable] = REGION_IV
    region[a & d & ~b & ~c] = REGION_V
    return region
