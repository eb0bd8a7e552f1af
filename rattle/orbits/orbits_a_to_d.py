"""The period-one motions A to D of any gear, and the regions of the plane that they define."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.notebook import Columns, html_of, html_table, motion_label, repr_text

NAMES = ("A", "B", "C", "D")
N_MINUS = (0, 1, 0, 1)


class Orbit(NamedTuple):
    """A period-one orbit P(m, n_plus, n_minus) of the impact map, at one of its impacts on Σ⁺.

    Attributes
    ----------
    tau, v : float
        Phase in [0, 1), and speed > 0 after the impact (change of Φ per forcing period).
    multipliers
        Both Floquet multipliers over m forcing periods, complex; their product is e^(−δm) if impacts are elastic.
    delta, epsilon, beta : float
        The parameter point.
    added : dict
        The values of the model's parameters besides δ, ε and β, by name.
    """

    name: str
    m: int
    n_plus: int
    n_minus: int
    tau: float
    v: float
    multipliers: tuple[complex, complex]
    stable: bool
    delta: float
    epsilon: float
    beta: float
    added: Mapping[str, float]

    def _caption(self) -> str:
        kind = "stable" if self.stable else "unstable"
        label = motion_label(self.m, self.n_plus, self.n_minus)
        return f"{self.name}: {label}, {kind}, τ = {self.tau:.6g}, v = {self.v:.6g}"

    def _columns(self) -> Columns:
        return orbit_columns((self,))

    def __repr__(self) -> str:
        """Return a description of the orbit in one line."""
        return repr_text(self)

    def _repr_html_(self) -> str:
        return html_of(self)


def orbit_columns(orbits: Sequence[Orbit]) -> Columns:
    """Return the columns of the table of orbits, with a row for each orbit."""
    return {
        "orbit": [each.name for each in orbits],
        "motion": [motion_label(each.m, each.n_plus, each.n_minus) for each in orbits],
        "tau": [each.tau for each in orbits],
        "v": [each.v for each in orbits],
        "multiplier_1": [each.multipliers[0] for each in orbits],
        "multiplier_2": [each.multipliers[1] for each in orbits],
        "stable": [each.stable for each in orbits],
    }


class PeriodOne(NamedTuple):
    """Orbits A, B, C, D at parameters of shape S.

    Fields have the shape (4, *S), multipliers (4, 2, *S). The values of an orbit that does not exist are False or NaN.
    """

    exists: NDArray[np.bool_]
    stable: NDArray[np.bool_]
    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    multipliers: NDArray[np.complex128]


def existing_orbits(
    found: PeriodOne, delta: float, epsilon: float, beta: float, added: Mapping[str, float]
) -> tuple[Orbit, ...]:
    """Return the orbits that exist at one parameter point, in the order A, B, C, D. Fields of `found` are (4,)."""
    return tuple(
        Orbit(
            name,
            1,
            1,
            N_MINUS[i],
            float(found.tau[i]),
            float(found.v[i]),
            (complex(found.multipliers[i, 0]), complex(found.multipliers[i, 1])),
            bool(found.stable[i]),
            delta,
            epsilon,
            beta,
            added,
        )
        for i, name in enumerate(NAMES)
        if found.exists[i]
    )


class MissingLimit(NamedTuple):
    """A limit of ε, SN1 or the flip of C, that does not exist at a damping.

    limit: its name, "sn1" or "flip". reason: why it does not exist, and the event that takes its place. epsilon: the
    eccentricity of this other event, None if there is none.
    """

    limit: str
    reason: str
    epsilon: float | None


# If |trace| is larger than this, the roots are computed without the determinant: it is negligible, and the square of
# the trace could overflow.
SQUARED = 1e150


def multipliers_from_trace(trace: ArrayLike, determinant: ArrayLike) -> NDArray[np.complex128]:
    """Return both roots of λ² − trace λ + determinant, the larger modulus first.

    The roots are computed without cancellation.

    Returns
    -------
    NDArray[np.complex128]
        The roots (2, …), with a new first axis.
    """
    t, d = np.broadcast_arrays(np.asarray(trace, np.float64), np.asarray(determinant, np.float64))
    with np.errstate(over="ignore"):
        root = np.sqrt((t * t / 4 - d).astype(np.complex128))
    root = np.where(np.abs(t) > SQUARED, np.abs(t / 2), root)
    large = t / 2 + np.where(t < 0, -root, root)
    with np.errstate(divide="ignore", invalid="ignore"):
        small = np.where(root.imag != 0, np.conj(large), d / large)
    return np.stack([large, small])


PAPER_REGIONS = ("I", "II", "III", "IV", "V")
# {motions that exist: the paper's region}; if all four exist, `classify_regions` changes III to IV where D is unstable
_PAPER_REGION_OF = {"": "I", "AC": "II", "ABCD": "III", "AD": "V"}
_SETS = ["".join(x for x, there in zip(NAMES, each[::-1], strict=True) if there) for each in product((0, 1), repeat=4)]
#: Names of regions by number: 0 is no region, 1 to 5 are I to V of the paper, others are named by their orbits.
REGIONS = ("", *PAPER_REGIONS, *(each for each in _SETS if each not in _PAPER_REGION_OF))
# number of the region of each set of orbits; bit i of an index says whether orbit number i of A to D is in the set
_CODES = np.array([REGIONS.index(_PAPER_REGION_OF.get(each, each)) for each in _SETS], np.int8)


def classify_regions(orbits: PeriodOne) -> NDArray[np.int8]:
    """Return the region of each parameter point from its period-one orbits.

    Region I has none of A to D, II has A and C, III all four with D stable, IV all four with D unstable, and V has A
    and D. Every other set of orbits has a number of its own.

    Returns
    -------
    NDArray[np.int8]
        Indices in REGIONS.
    """
    region = np.asarray(_CODES[np.tensordot(1 << np.arange(len(NAMES)), orbits.exists, 1)])
    region[orbits.exists.all(axis=0) & ~orbits.stable[3]] = REGIONS.index("IV")
    return region


def region_in_words(region: int) -> str:
    """Return a region in words: "region III", or "orbits A, B and D, no region of the paper"."""
    name = REGIONS[region]
    if name in PAPER_REGIONS:
        return f"region {name}"
    if len(name) == 1:
        return f"orbit {name}, no region of the paper"
    return f"orbits {', '.join(name[:-1])} and {name[-1]}, no region of the paper"


class GearWithOrbits(Protocol):
    """The interface of a gear at one parameter point: its quiet limit, its region and its period-one orbits."""

    @property
    def quiet_limit(self) -> float:
        """Eccentricity above which permanent contact is impossible."""

    def region(self) -> int:
        """Return the number of the region, an index in REGIONS."""

    def orbits(self) -> tuple[Orbit, ...]:
        """Return the admissible period-one orbits."""


def notebook_html_of_gear(gear: GearWithOrbits) -> str:
    """Return the HTML that a notebook shows for a gear."""
    caption = f"{gear!r}: {region_in_words(gear.region())}, quiet limit ε = {gear.quiet_limit:.6g}"
    return html_table(caption, orbit_columns(gear.orbits()))
