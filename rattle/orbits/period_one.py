"""The period-one motions A to D as any gear has them, and the regions of the plane that they make."""

from itertools import product
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


PAPER_REGIONS = ("I", "II", "III", "IV", "V")
_OF_THE_PAPER = {"": "I", "AC": "II", "ABCD": "III", "AD": "V"}  # III is IV where D is unstable
_SETS = ["".join(x for x, there in zip(NAMES, each[::-1], strict=True) if there) for each in product((0, 1), repeat=4)]
#: By code: 0 is no region, 1 to 5 are those of the paper, and all other sets of orbits that exist are their own names.
REGIONS = ("", *PAPER_REGIONS, *(each for each in _SETS if each not in _OF_THE_PAPER))
_CODES = np.array([REGIONS.index(_OF_THE_PAPER.get(each, each)) for each in _SETS], np.int8)  # by the set's bits


def classify(orbits: PeriodOne) -> NDArray[np.int8]:
    """Region of each parameter point, as its number in REGIONS, from its period-one orbits.

    I: none of A–D. II: A and C. III: all four, D stable. IV: all four, D unstable. V: A and D. Any other set of orbits
    is a region of its own, named by it: ABD.
    """
    region = np.asarray(_CODES[np.tensordot(1 << np.arange(len(NAMES)), orbits.exists, 1)])
    region[orbits.exists.all(axis=0) & ~orbits.stable[3]] = REGIONS.index("IV")
    return region


def in_words(region: int) -> str:
    """A region in a sentence: region III; or orbits A, B and D, no region of the paper."""
    name = REGIONS[region]
    if name in PAPER_REGIONS:
        return f"region {name}"
    if len(name) == 1:
        return f"orbit {name}, no region of the paper"
    return f"orbits {', '.join(name[:-1])} and {name[-1]}, no region of the paper"
