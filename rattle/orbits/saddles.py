"""Saddles of Π^k of any model, and their local manifolds as power series (parametrisation method).

F is Π^k for the unstable manifold and Π^−k for the stable manifold, applied twice if the multiplier is negative. So its
multiplier λ along the manifold is larger than 1. The local manifold W(s) solves

    F(W(s)) = W(λs),    W(0) the saddle,    W'(0) its unit eigenvector.

Then W(s) = F^j(W(s/λ^j)) for any s, so one number s gives the position of any point of the whole manifold. Source: X.
Cabré, E. Fontich, R. de la Llave, J. Differ. Equations 218 (2005) 444.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from rattle.errors import RattleError, require
from rattle.flight.law import fold_phase
from rattle.orbits.images import apply_unfolded_map_power
from rattle.orbits.periodic_motions import PeriodicMotion
from rattle.orbits.return_map import apply_return_map_power

Array = NDArray[np.float64]
DEGREE, NODES = 10, 25  # degree of the series; number of points at which its residual is evaluated
LARGEST, SMALLEST = 0.1, 1e-9  # largest and smallest size that is tried for a series; the series is used for |s| ≤ size
# largest allowed residual F(W(s)) − W(λs) of a series, relative to the size of the series
RESIDUAL = 1e-12
# rounding error of a residual for Π and for Π⁻¹, relative to the speed of the saddle; residuals below it are allowed
ROUNDING = (4e-15, 8e-15)
MOST_ITERATIONS = 60


@dataclass(frozen=True)
class LocalManifold:
    """The local manifold W(s) for |s| ≤ size, as a power series in s/size.

    Attributes
    ----------
    series_coefficients : (DEGREE + 1, 2)
        Coefficients of τ and v, the lowest power first.
    multiplier : float
        The multiplier λ of the map F along the manifold.
    backwards : bool
        True for a stable manifold, whose map F goes backwards in time.
    steps, turns : int
        Impacts on Σ⁺ and forcing periods of one application of F.
    residual : float
        The largest |F(W(s/λ)) − W(s)|, with speeds in units of `unit`.
    unit : float
        The speed difference that counts as one forcing period in residuals.
    """

    orbit: PeriodicMotion
    backwards: bool
    series_coefficients: Array
    size: float
    multiplier: float
    steps: int
    turns: int
    residual: float = np.inf
    unit: float = 1.0

    def states_at(self, s: Array) -> Array:
        """Return the states (2, n) of the local manifold at positions s (n,), |s| ≤ size; τ may leave [0, 1)."""
        return np.asarray(polyval(np.asarray(s) / self.size, self.series_coefficients), np.float64)

    def map(self, states: Array, times: int) -> tuple[NDArray[np.bool_], Array, NDArray[np.int64], NDArray[np.int64]]:
        """Apply the map F of this manifold `times` times to states (2, n).

        Returns
        -------
        tuple
            Flags (n,) of the states that have an image; the images (2, n); the hashes of their itineraries (n,); and
            their numbers of impacts on Σ⁻ (n,).
        """
        tau, v = (np.ascontiguousarray(x) for x in states)
        steps, turns = times * self.steps, times * self.turns
        ok, tau, v, word, bounces = apply_unfolded_map_power(tau, v, steps, turns, self.backwards, self.orbit.point)
        return ok, np.stack([tau, v]), word, bounces

    def image(self, s: Array, times: int) -> tuple[NDArray[np.bool_], Array, NDArray[np.int64], NDArray[np.int64]]:
        """Map the states W(s) at positions s (n,) on the whole manifold by F^times; the results are those of `map`."""
        more = max(0, int(np.ceil(np.log(np.abs(s).max() / self.size) / np.log(self.multiplier))))
        return self.map(self.states_at(s / self.multiplier**more), times + more)


def tangent_map(orbit: PeriodicMotion) -> Array:
    """Return the tangent map (2, 2) in (τ, v) of a periodic orbit over its period; at a graze it is infinite."""
    product, tau, v = np.eye(2), float(fold_phase(orbit.tau)), orbit.v
    for _ in range(orbit.label[1]):
        found = apply_return_map_power(tau, v, 1, orbit.point)
        tau, v = found[1:3]
        product = np.array(found[5:9]).reshape(2, 2) @ product
    return product


def eigenvectors(orbit: PeriodicMotion) -> tuple[Array, Array]:
    """Return the unit eigenvectors (2,) of a saddle in (τ, v), for its unstable and its stable multiplier.

    Returns
    -------
    tuple[Array, Array]
        Both vectors, which point towards rising v (rising τ if v does not change along them).
    """
    values, vectors = np.linalg.eig(tangent_map(orbit))
    unstable, stable = (np.real(vectors[:, i]) for i in np.argsort(-np.abs(values)))
    unstable, stable = (x * np.sign(x[1] if abs(x[1]) > 1e-9 else x[0]) for x in (unstable, stable))
    return unstable, stable


def local_manifold(orbit: PeriodicMotion, stable: bool, unit: float = 1.0) -> LocalManifold:
    """Return the stable or the unstable local manifold of a saddle.

    The series has degree 10. Its size is the largest of 0.1, 0.05, … for which the residual |F(W(s)) − W(λs)| is at
    most 1e-12 of the size; if rounding errors or λ are large, a larger residual is allowed. In residuals speeds are in
    units of `unit`.

    Returns
    -------
    LocalManifold
        The coefficients of the series, and its size.

    Raises
    ------
    ParameterError
        If the orbit is not a saddle.
    RattleError
        If no series converges, mostly because the saddle is close to grazing.
    """
    large, small = orbit.multipliers
    saddle = orbit.admissible and np.isfinite(large) and abs(large) > 1.0 > abs(small) > 0.0
    require(
        bool(saddle),
        "the orbit is no saddle: it must be admissible, with one multiplier inside the unit circle and one outside, "
        f"got {large} and {small}",
    )
    multiplier = float(1.0 / np.real(small) if stable else np.real(large))
    twice = 2 if multiplier < 0 else 1
    multiplier **= twice
    powers = np.zeros((DEGREE + 1, 2))
    powers[0], powers[1] = (orbit.tau, orbit.v), eigenvectors(orbit)[1 if stable else 0]
    size = LARGEST
    derivative = np.linalg.matrix_power(tangent_map(orbit), -twice if stable else twice)
    scaled = derivative * [[1.0, unit], [1.0 / unit, 1.0]]
    rounding = ROUNDING[stable] * max(1.0, orbit.v / unit) * max(1.0, float(np.linalg.norm(scaled)))
    while size > SMALLEST:
        start = LocalManifold(
            orbit, stable, powers, 1.0, multiplier, twice * orbit.label[1], twice * orbit.m, unit=unit
        )
        found = _solve_series(start, size, np.asarray(derivative, np.float64))
        if found is not None and found.residual < max(rounding, RESIDUAL * size * max(1.0, multiplier / 10.0)):
            return found
        size /= 2.0
    raise RattleError(
        f"no series of the local manifold of the saddle at tau = {orbit.tau}, v = {orbit.v} converges: "
        "the saddle may be too close to grazing, so choose other parameters"
    )


def _solve_series(start: LocalManifold, size: float, derivative: Array) -> LocalManifold | None:
    """Return the local manifold as a series for |s| ≤ size, from its two lowest coefficients in `start`.

    In each iteration coefficient k changes by (λ^k − DF)⁻¹ times coefficient k of the residual F(W(s)) − W(λs). This is
    Newton's step without the second derivative of F.

    Returns
    -------
    LocalManifold | None
        The local manifold; None if Γ crosses it, or if the iteration diverges.
    """
    x = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
    solve = np.linalg.pinv(np.vander(x, DEGREE + 1, increasing=True)[:, 2:])
    rates = start.multiplier ** np.arange(2, DEGREE + 1)
    inverse = np.linalg.inv(rates[:, None, None] * np.eye(2) - derivative)
    powers = start.series_coefficients * np.array([1.0, size] + [0.0] * (DEGREE - 1))[:, None]
    local, last = replace(start, series_coefficients=powers, size=size), np.inf
    for _ in range(MOST_ITERATIONS):
        before = local.states_at(size * x / local.multiplier)
        if not (before[1] > 0).all():
            return None
        ok, states, word, _ = local.map(before, 1)
        if not (ok.all() and (word == word[0]).all()):
            return None
        off = states - local.states_at(size * x)
        local = replace(local, residual=float((np.abs(off) / [[1.0], [local.unit]]).max()))
        new = local.series_coefficients.copy()
        # `off` is the residual as a function of λs. Its coefficient k times λ^k (`rates`) is therefore coefficient k of
        # the residual as a function of s.
        new[2:] += np.einsum("kij,kj->ki", inverse * rates[:, None, None], solve @ off.T)
        change = float((np.abs(new - local.series_coefficients) / [1.0, local.unit]).max())
        if change < 1e-16 or (
            local.residual < ROUNDING[start.backwards] * start.orbit.v / start.unit and change >= last
        ):
            break
        if not change < 1.0:
            return None
        local, last = replace(local, series_coefficients=new), change
    return local
