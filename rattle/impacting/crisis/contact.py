"""Solve for the contact of a piece of W^u(A) with W^s(A): one scalar equation for ε, from a guess.

W^u(A) and W^s(A) are the unstable and the stable manifold of the saddle A. W(s) is the point of W^u(A) at position s,
which near A is the arclength from A. Π is the impact map, and n the number of impacts on Σ⁺ after which the piece
returns to A. h(s, ε) is the signed distance of Πⁿ(W(s)) from the local series of W^s(A), positive on the side of the
attractor. The piece touches W^s(A) at the ε at which the minimum of h along the piece vanishes. The contact is a corner
or a smooth bend of W^u(A).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.polynomial.polynomial import polyder, polyval
from numpy.typing import NDArray

from rattle.errors import RattleError
from rattle.impacting.orbits.limits import sn1_formula
from rattle.impacting.orbits.periodic import period_one_orbit
from rattle.orbits.saddles import Array, LocalManifold, eigenvectors, local_manifold

GRID, ZOOMS = 41, 13  # number of points of a grid in s on which a minimum is sought; number of ever finer grids
# distance in s from the contact, relative to s, of the two points on either side whose itineraries are compared
SAME = 1e-9
# points of W^u(A) that are LONG impacts or more away from the local series are interpolated between NODES nodes
LONG, NODES = 30, 16
NEWTON = 4  # number of Newton steps to the position of a state along W^s(A)
MOST_ROUNDS = 40  # an interval is moved at most this many times until it holds a root


@dataclass(frozen=True)
class Crisis:
    """A boundary crisis of the saddle A at (delta, epsilon, beta), all dimensionless.

    Attributes
    ----------
    contact : "corner" or "tangency"
        The shape of W^u(A) at the contact.
    piece : tuple[int, ...]
        The itinerary of the contact's orbit: the number of impacts on Σ⁻ between each two successive impacts on Σ⁺,
        without the zeros at the beginning and at the end. At a corner the orbits on the two sides differ; the side with
        more impacts on Σ⁻ counts.
    parameter : float
        Position s on W^u(A) of one point of the contact's orbit; near A, s is the arclength from A. From this point the
        orbit meets Σ⁻ first in its second return to Σ⁺.
    steps : int
        Number of impacts on Σ⁺ from the point at `parameter` until the orbit is back near A, at W^s(A).
    chaotic : bool
        Whether the attractor of W^u(A) just below the crisis was observed to be chaotic. In a window of periodic motion
        the attractor is not chaotic, and the contact ends chaotic transients only.
    """

    delta: float
    epsilon: float
    beta: float
    contact: str
    piece: tuple[int, ...]
    parameter: float
    steps: int
    chaotic: bool = True

    @property
    def epsilon_above_sn1(self) -> float:
        """The crisis's ε minus the ε of the saddle-node SN1 at this damping, by the formula of SN1."""
        return self.epsilon - float(sn1_formula(self.delta))


class SaddleManifolds:
    """The saddle A at one parameter point, with its unstable manifold W^u(A) and its stable manifold W^s(A)."""

    def __init__(self, delta: float, epsilon: float, beta: float) -> None:
        self.saddle = period_one_orbit("A", delta, epsilon, beta)
        self.unstable_manifold: LocalManifold = local_manifold(self.saddle, stable=False)
        self.saddle_state = np.array([[self.saddle.tau], [self.saddle.v]])

    @cached_property
    def stable_manifold(self) -> LocalManifold:
        """The local part of W^s(A), the stable manifold of the saddle A, as a power series."""
        return local_manifold(self.saddle, stable=True)

    @cached_property
    def matrix_to_eigenvectors(self) -> Array:
        """The matrix (2, 2) that maps (τ, v) − A to its components along the unstable and the stable eigenvector."""
        return np.asarray(np.linalg.inv(np.stack(eigenvectors(self.saddle), axis=1)), np.float64)

    def signed_distances_from_stable_manifold(self, states: Array) -> tuple[Array, Array]:
        """Return the signed distance of states (2, n) from W^s(A), and their positions t along W^s(A).

        The distance is measured along the unstable eigenvector; near A, |t| is the arclength from A, relative to the
        size of the local series. Both are inf for states farther along W^s(A) than this series reaches (|t| > 1).

        Returns
        -------
        tuple[Array, Array]
            Distances and positions, each (n,).
        """
        along, across = (
            self.matrix_to_eigenvectors[1] @ (states - self.saddle_state),
            self.matrix_to_eigenvectors[0] @ (states - self.saddle_state),
        )
        series = (
            self.stable_manifold.series_coefficients
            - self.stable_manifold.series_coefficients[0]
            * (np.arange(self.stable_manifold.series_coefficients.shape[0]) == 0)[:, None]
        ).T
        unstable, stable = self.matrix_to_eigenvectors @ series
        t = along / self.stable_manifold.size
        with np.errstate(all="ignore"):
            for _ in range(NEWTON):
                t = t - (polyval(t, stable) - along) / polyval(t, polyder(stable))
            inside = np.abs(t) <= 1.0
            return np.where(inside, across - polyval(t, unstable), np.inf), np.where(inside, t, np.inf)

    def unstable_manifold_points(self, s: Array) -> Array:
        """Return the points W(s) (2, n) at positions s (n,) on the part of W^u(A) before its first impact on Σ⁻."""
        local = self.unstable_manifold
        low, high = float(s.min()), float(s.max())
        if np.log(high / local.size) < LONG * np.log(local.multiplier) or not high > low:
            return local.image(s, 0)[1]
        states = local.image(0.5 * (low + high) + 0.5 * (high - low) * chebyshev.chebpts1(NODES), 0)[1]
        powers = chebyshev.chebfit(chebyshev.chebpts1(NODES), (states - self.saddle_state).T, NODES - 1)
        return np.asarray(
            chebyshev.chebval((2.0 * s - low - high) / (high - low), powers) + self.saddle_state, np.float64
        )

    def distances_after_impacts(self, s: Array, n: int) -> tuple[Array, NDArray[np.int64]]:
        """Return the signed distances (m,) of Πⁿ(W(s)) from the local part of W^s(A), and hashes of the itineraries.

        W(s) are the points of W^u(A) at the positions s (m,), and Π is the impact map. A distance is inf if the state
        Πⁿ(W(s)) does not exist or lies beyond the local part.

        Returns
        -------
        tuple[Array, NDArray[np.int64]]
            Distances and hashes.
        """
        ok, states, word, _ = self.unstable_manifold.map(self.unstable_manifold_points(s), n)
        return np.where(ok, self.signed_distances_from_stable_manifold(states)[0], np.inf), word

    def least_distance_from_stable_manifold(self, window: tuple[float, float], n: int) -> tuple[float, float]:
        """Return the least signed distance of Πⁿ(W(s)) from W^s(A) for s in a window, and s of this point.

        W(s) is the point of W^u(A) at position s, and Π the impact map. The minimum is searched on ever finer grids.

        Returns
        -------
        tuple[float, float]
            The signed distance (`signed_distances_from_stable_manifold`), and s.
        """
        low, high = window
        for _ in range(ZOOMS):
            s = np.linspace(low, high, GRID)
            values = self.distances_after_impacts(s, n)[0]
            i = int(np.argmin(values))
            low, high = s[max(i - 1, 0)], s[min(i + 1, GRID - 1)]
        return float(values[i]), float(s[i])

    def impacts_on_minus_per_return(self, s: float, n: int) -> tuple[int, ...]:
        """Return the number of impacts on Σ⁻ in each of n returns to Σ⁺ from position s of W^u(A).

        Returns
        -------
        tuple[int, ...]
            The numbers in order, without the zeros at the beginning and at the end.
        """
        start = self.unstable_manifold_points(np.array([s]))
        counts = np.array([int(self.unstable_manifold.map(start, j)[3][0]) for j in range(n + 1)])
        found = np.diff(counts)
        some = np.flatnonzero(found)
        return tuple(int(x) for x in found[some[0] : some[-1] + 1]) if some.size else ()


@lru_cache(maxsize=256)
def saddle_manifolds_at(delta: float, epsilon: float, beta: float) -> SaddleManifolds:
    """Return the saddle A at a parameter point with both manifolds; the latest results are kept."""
    return SaddleManifolds(delta, epsilon, beta)


def solve_manifold_contact(
    delta: float, beta: float, gap: float, window: tuple[float, float], n: int, bracket: float
) -> Crisis:
    """Return the contact of a piece of W^u(A) with W^s(A) at the damping delta, near ε = SN1 + gap.

    Parameters
    ----------
    delta, beta, gap : float
        Damping, half-backlash, and the guess of ε − SN1 at the contact.
    window : tuple[float, float]
        Range of positions s on W^u(A) that holds the piece.
    n : int
        Impacts on Σ⁺ after which the piece returns to A.
    bracket : float
        Expected error of the guess `gap`, relative to `gap`.

    Returns
    -------
    Crisis
        The contact, with the ε at which the piece touches W^s(A), and the shape of the contact.

    Raises
    ------
    RattleError
        If the piece has no contact there.
    """
    floor = float(sn1_formula(delta))

    def least_distance_at(x: float) -> float:
        return saddle_manifolds_at(delta, floor + x, beta).least_distance_from_stable_manifold(window, n)[0]

    return _build_crisis(
        delta,
        floor + _solve_for_manifold_contact("epsilon - SN1", least_distance_at, gap, bracket * gap, 0.2),
        beta,
        window,
        n,
    )


def solve_manifold_contact_above_sn1(
    delta: float, beta: float, gap: float, window: tuple[float, float], n: int, bracket: float, most: float
) -> Crisis:
    """Return the contact of a piece of W^u(A) with W^s(A) at ε = SN1 + gap. δ is the unknown, and `delta` its guess.

    bracket: the expected error of the guess of δ. most: the longest step in δ while a root is searched. The other
    arguments and the errors are those of `solve_manifold_contact`.

    Returns
    -------
    Crisis
        The contact, with the δ at which the piece touches W^s(A), and the shape of the contact.
    """

    def least_distance_at(x: float) -> float:
        return saddle_manifolds_at(x, float(sn1_formula(x)) + gap, beta).least_distance_from_stable_manifold(window, n)[
            0
        ]

    found = _solve_for_manifold_contact("delta", least_distance_at, delta, bracket, most / delta)
    return _build_crisis(found, float(sn1_formula(found)) + gap, beta, window, n)


def _solve_for_manifold_contact(
    name: str, distance_at: Callable[[float], float], x: float, half_width: float, most: float
) -> float:
    """Return the value near x of an unknown parameter at which a piece of W^u(A) has distance 0 from W^s(A).

    distance_at: a function of the unknown that returns the signed distance.
    name: the name of the unknown, for the message. The interval from x − half_width to x + half_width is moved in steps
    until the distance has different signs at its ends. most: the longest step, relative to the interval's lower end.

    Returns
    -------
    float
        The value of the unknown at the contact.

    Raises
    ------
    RattleError
        If no contact is found.
    """
    from scipy.optimize import brentq  # imported here because it takes a quarter of a second to load

    low, high = x - half_width, x + half_width
    at_low, at_high = distance_at(low), distance_at(high)
    for _ in range(MOST_ROUNDS):
        if at_low * at_high <= 0.0 or not np.isfinite(at_low - at_high):
            break
        step = min(2.0 * (high - low), most * low)
        if abs(at_low) < abs(at_high):
            low, high, at_high = low - step, low, at_low
            at_low = distance_at(low)
        else:
            low, high, at_low = high, high + step, at_high
            at_high = distance_at(high)
    if not at_low * at_high <= 0.0:
        raise RattleError(f"W^u(A) was not found to touch W^s(A) near {name} = {x}")
    return float(brentq(distance_at, low, high, xtol=1e-17, rtol=4 * np.finfo(float).eps))


def _build_crisis(delta: float, epsilon: float, beta: float, window: tuple[float, float], n: int) -> Crisis:
    """Return the crisis at these parameters, with the position and the shape of the contact in a window of s."""
    here = saddle_manifolds_at(delta, epsilon, beta)
    s = here.least_distance_from_stable_manifold(window, n)[1]
    if min(s - window[0], window[1] - s) < 1e-3 * (window[1] - window[0]):
        raise RattleError(
            f"W^u(A) comes closest to W^s(A), near epsilon = {epsilon}, at an end of the searched part of W^u(A), so "
            "no point is found at which W^u(A) touches W^s(A)"
        )
    sides = [here.impacts_on_minus_per_return(s * (1.0 + side * SAME), n) for side in (-1, 1)]
    contact = "tangency" if sides[0] == sides[1] else "corner"
    return Crisis(delta, epsilon, beta, contact, max(sides, key=sum), s, n)


def manifold_contact_position(crisis: Crisis) -> float:
    """Return where W^u(A) touches the local series of W^s(A), as a position: 0 at A, 1 at the end of the series."""
    here = saddle_manifolds_at(crisis.delta, crisis.epsilon, crisis.beta)
    start = here.unstable_manifold_points(np.array([crisis.parameter]))
    return abs(
        float(here.signed_distances_from_stable_manifold(here.unstable_manifold.map(start, crisis.steps)[1])[1][0])
    )


def square_root_coefficient(crisis: Crisis) -> float:
    """Return the coefficient b of h = b √x + c x + … at the corner of W^u(A) next to this contact.

    h is the distance from W^s(A) after `crisis.steps` impacts on Σ⁺. x is the distance from the corner along W^u(A),
    relative to the position of the contact, on the side of the corner on which h has a square root. If b is positive,
    the corner touches W^s(A); if b is negative, the smooth bend beside the corner touches W^s(A).

    Returns
    -------
    float
        b, in units of h.

    Raises
    ------
    RattleError
        If W^u(A) has no corner within 5 % of the position of the contact.
    """
    here, s, n = saddle_manifolds_at(crisis.delta, crisis.epsilon, crisis.beta), crisis.parameter, crisis.steps
    around = s * (1.0 + np.concatenate([-np.geomspace(0.05, 1e-12, 60), np.geomspace(1e-12, 0.05, 60)]))
    word = here.distances_after_impacts(around, n)[1]
    edges = np.flatnonzero(word[1:] != word[:-1])
    if not edges.size:
        raise RattleError(
            f"W^u(A) has no corner within 5 % of the position along W^u(A) at which it touches W^s(A), at delta = "
            f"{crisis.delta}: choose a crisis at another delta"
        )
    i = int(edges[np.argmin(np.abs(around[edges] - s))])
    low, high, first = around[i], around[i + 1], word[i]
    while low < (middle := 0.5 * (low + high)) < high:
        same = here.distances_after_impacts(np.array([middle]), n)[1][0] == first
        low, high = (middle, high) if same else (low, middle)
    more = 1 if sum(here.impacts_on_minus_per_return(high, n)) > sum(here.impacts_on_minus_per_return(low, n)) else -1
    root = np.linspace(0.2, 1.0, 12) * 1e-2
    heights = here.distances_after_impacts((high if more > 0 else low) + more * s * root**2, n)[0]
    corner = float(here.distances_after_impacts(np.array([low if more > 0 else high]), n)[0][0])
    return float(np.polyfit(root, (heights - corner) / root, 4)[-1])
