"""Equations of the periodic motions of any gear, their solution, and the properties that all these motions have."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from rattle.flight import law
from rattle.flight.impact_law import ELASTIC, ImpactLaw
from rattle.notebook import Columns, DataFrame, dataframe_of, html_of, motion_label, repr_text
from rattle.numerics.complex_step import Array, value_and_jacobian
from rattle.orbits.orbits_a_to_d import multipliers_from_trace


@dataclass(frozen=True)
class Equations(ABC):
    """The itinerary of a periodic motion, and the n equations that the motion satisfies in its n unknowns.

    walls: +1 or −1 for each impact or contact of a period, in order, Σ⁺ first. m: number of forcing periods. beta:
    half-backlash. The unknowns are the times of the impacts or contacts, followed by further unknowns if the gear has
    any. Arrays x (…, n + 2) hold the unknowns, then δ and ε.
    """

    walls: tuple[int, ...]
    m: int
    beta: float

    law: ClassVar[ImpactLaw] = ELASTIC

    @property
    @abstractmethod
    def n(self) -> int:
        """Number of unknowns of the motion, without δ and ε."""

    @abstractmethod
    def residual(self, x: NDArray) -> NDArray:
        """Return the residual R (…, n) of the equations at x (…, n + 2), which is 0 for a solution."""

    @abstractmethod
    def evaluate_with_jacobian(self, x: NDArray, multiplier: float) -> tuple[NDArray, NDArray]:
        """Return the residual R and its Jacobian J(λ) (…, n, n) for perturbations that grow by λ over a period."""

    @abstractmethod
    def residual_with_graze(self, x: NDArray, impact: int) -> NDArray:
        """Return an array (…, n + 1): the residual R, then an entry that is 0 if impact number `impact` grazes."""

    def jacobian(self, x: NDArray, multiplier: float = 1.0) -> NDArray:
        """Return the Jacobian J(λ) (…, n, n) of `evaluate_with_jacobian` for λ = `multiplier`."""
        return self.evaluate_with_jacobian(x, multiplier)[1]

    @property
    def label(self) -> tuple[int, int, int]:
        """Label (m, n_plus, n_minus)."""
        return self.m, self.walls.count(1), self.walls.count(-1)

    def with_walls(self, walls: tuple[int, ...], m: int | None = None) -> Self:
        """Return the itinerary of a motion of this gear with other walls, in m forcing periods (None: the same m)."""
        return replace(self, walls=walls, m=self.m if m is None else m)

    def with_first_impact(self, first: int) -> Self:
        """Return the itinerary of the same motion, rotated so that impact number `first` comes first."""
        return self.with_walls(self.walls[first:] + self.walls[:first])

    def without_impact(self, impact: int) -> Self:
        """Return the itinerary of the motion that makes all impacts except impact number `impact`."""
        return self.with_walls(self.walls[:impact] + self.walls[impact + 1 :])

    def with_added_impact(self, impact: int, wall: int) -> Self:
        """Return the itinerary with one more impact, which becomes number `impact`."""
        return self.with_walls((*self.walls[:impact], wall, *self.walls[impact:]))

    def with_doubled_period(self) -> Self:
        """Return the itinerary over twice the period: the walls of this itinerary in order, then once more in order."""
        return self.with_walls(self.walls * 2, 2 * self.m)

    def with_divided_period(self, parts: int) -> Self:
        """Return the itinerary which, repeated `parts` times, is this itinerary."""
        return self.with_walls(self.walls[: len(self.walls) // parts], self.m // parts)


Itinerary = TypeVar("Itinerary", bound=Equations)


def unknowns_counted_from_impact(itinerary: Equations, x: Array, first: int) -> Array:
    """Return the unknowns and parameters (N,) of the motion x, with its impacts counted from impact number `first`."""
    each = x[: itinerary.n].reshape(-1, len(itinerary.walls))
    turned = np.concatenate([each[:, first:], each[:, :first]], axis=1)
    turned[0, len(itinerary.walls) - first :] += itinerary.m
    return np.concatenate([turned.ravel(), x[itinerary.n :]])


def equivalent_unknowns(itinerary: Equations, start: Array, x: Array) -> Array:
    """Return all arrays of unknowns that describe the motion with the unknowns `start`, near the unknowns x.

    The arrays begin at different impacts, from each of which the motion meets the walls in the order of the itinerary.
    The times of each array are shifted by whole forcing periods so that its first time is nearest to that of x.

    Returns
    -------
    Array
        The arrays (k, N), with δ and ε at the end; one of them is `start` (N,), shifted by whole periods.
    """
    n, walls = len(itinerary.walls), itinerary.walls
    found = np.array(
        [unknowns_counted_from_impact(itinerary, start, k) for k in range(n) if walls[k:] + walls[:k] == walls]
    )
    found[:, :n] -= np.rint(found[:, :1] - x[0])
    return found


def shorten_to_least_period(itinerary: Itinerary, x: Array) -> tuple[Itinerary, Array]:
    """Return itinerary and unknowns of the motion x (n + 2,) with its least period.

    If the motion repeats after fewer than m forcing periods, the itinerary is shortened to one repetition, and the
    unknowns are solved for again.

    Returns
    -------
    tuple[Itinerary, Array]
        The itinerary, and the unknowns followed by δ and ε.
    """
    impacts = len(itinerary.walls)
    for parts in range(math.gcd(impacts, itinerary.m), 1, -1):
        shift, odd = divmod(impacts, parts)
        if odd or itinerary.m % parts or itinerary.walls[shift:] + itinerary.walls[:shift] != itinerary.walls:
            continue
        later = unknowns_counted_from_impact(itinerary, x, shift)
        later[:impacts] -= itinerary.m // parts
        if np.max(np.abs(later - x)) < SAME_MOTION:
            shorter = itinerary.with_divided_period(parts)
            first = np.concatenate([x[: itinerary.n].reshape(-1, impacts)[:, :shift].ravel(), x[itinerary.n :]])
            solved = solve_at_parameters(shorter, first)
            return shorter, first if solved is None else solved
    return itinerary, x


MOST_IMPACTS = 512  # largest allowed number of impacts of a periodic motion
MOST_NEWTON = 30
# A part of a motion counts as a repetition of the part before if their times, in forcing periods, differ by less than
# this. The limit is far above usual rounding errors, because rounding errors grow near a flip.
SAME_MOTION = 1e-8


@dataclass(frozen=True, repr=False)
class PeriodicMotion(ABC):
    """A periodic motion P(m, n_plus, n_minus) of any model at one parameter point.

    Attributes
    ----------
    walls : (n,)
        Wall of each impact or contact, +1 or −1, Σ⁺ first.
    times : (n,)
        Times at which the impacts or contacts begin, in forcing periods, the first in [0, 1).
    speeds : (n,)
        Speed after each impact or contact; positive away from the wall, negative where the motion is virtual.
    multipliers
        Both Floquet multipliers over m forcing periods, the larger modulus first. Their product is e^(−δm) if impacts
        are elastic. At a graze of the impacting model they are infinite and 0.
    admissible : bool
        True if the motion is admissible, False if it is virtual.
    """

    delta: float
    epsilon: float
    beta: float
    m: int
    walls: tuple[int, ...]
    times: NDArray[np.float64]
    speeds: NDArray[np.float64]
    multipliers: tuple[complex, complex]
    admissible: bool

    @classmethod
    def from_solution(
        cls, itinerary: Equations, x: Array, speeds: Array, trace: float, admissible: bool, **more: Any
    ) -> Self:
        """Return the motion at a solution x (n + 2,) of its equations.

        trace: the trace of the tangent map over the period.

        Returns
        -------
        Self
            The motion, with its times shifted by whole periods so that the first is in [0, 1).
        """
        n = itinerary.n
        determinant = itinerary.law.determinant(x[n], itinerary.m, len(itinerary.walls))
        large, small = (complex(np.inf), 0j) if np.isinf(trace) else multipliers_from_trace(trace, determinant)
        times, multipliers = x[: len(itinerary.walls)] - np.floor(x[0]), (complex(large), complex(small))
        here = float(x[n]), float(x[n + 1]), itinerary.beta, itinerary.m, itinerary.walls
        return cls(*here, times, speeds, multipliers, admissible, **more)

    @property
    @abstractmethod
    def departures(self) -> Array:
        """Times (n,) at which the motion leaves the walls, in the order of `speeds`."""

    @property
    @abstractmethod
    def point(self) -> Any:
        """The motion's parameter point for kernels."""

    @property
    def added(self) -> tuple[str, ...]:
        """Names of the model's parameters besides δ, ε and β."""
        return ()

    @property
    def tau(self) -> float:
        """Phase in [0, 1) at which the motion first leaves Σ⁺."""
        return float(law.fold_phase(self.departures[0]))

    @property
    def v(self) -> float:
        """Speed with which the motion first leaves Σ⁺."""
        return float(self.speeds[0])

    @property
    def n_plus(self) -> int:
        """Number of impacts on Σ⁺ in a period."""
        return self.walls.count(1)

    @property
    def n_minus(self) -> int:
        """Number of impacts on Σ⁻ in a period."""
        return self.walls.count(-1)

    @property
    def label(self) -> tuple[int, int, int]:
        """Label (m, n_plus, n_minus)."""
        return self.m, self.n_plus, self.n_minus

    @property
    def stable(self) -> bool:
        """True if the motion is admissible and attracts."""
        return self.admissible and abs(self.multipliers[0]) < 1.0

    def _caption(self) -> str:
        kind = "stable" if self.stable else "unstable" if self.admissible else "virtual"
        return f"{motion_label(*self.label)} at δ = {self.delta:.6g}, ε = {self.epsilon:.6g}, {kind}"

    def _columns(self) -> Columns:
        return {"wall": self.walls, "departure": self.departures, "speed": self.speeds}

    def __repr__(self) -> str:
        """Return a description of the motion in one line."""
        return repr_text(self)

    def _repr_html_(self) -> str:
        return html_of(self)

    def to_dataframe(self) -> DataFrame:
        """Return the impacts or contacts of the motion: the walls, and times and speeds of the departures.

        Returns
        -------
        DataFrame
            A row for each impact or contact, with times in forcing periods.

        Raises
        ------
        MissingExtraError
            If pandas is not installed.
        """
        return dataframe_of(self)


def solve_at_parameters(itinerary: Equations, x: Array) -> Array | None:
    """Solve for the unknowns of x = (unknowns (n,), δ, ε) at these δ and ε by Newton's method; None if it fails."""
    n, x = itinerary.n, x.copy()
    for _ in range(MOST_NEWTON):
        value, jacobian = value_and_jacobian(itinerary.residual, x)
        if not (np.isfinite(value).all() and np.isfinite(jacobian).all()):
            return None
        try:
            step = np.linalg.solve(jacobian[:, :n], -value)
        except np.linalg.LinAlgError:
            return None
        size = float(np.max(np.abs(step)))
        x[:n] += step * min(1.0, 0.05 / size) if size > 0 else 0.0
        if size < 1e-13 * max(1.0, itinerary.m):
            return x
    return x if size < 1e-11 else None
