"""Saddles of Π^k of either model, and their manifolds close by: power series in the parameter that the map multiplies.

F is Π^k on the unstable side and Π^−k on the stable one, twice that where the multiplier is negative, so that λ > 1.
The local manifold W(s) solves F(W(s)) = W(λs), W(0) the saddle, W'(0) its unit eigenvector: then W(s) = F^j(W(s/λ^j))
for any s, and one number s is the place on the whole manifold. Source: X. Cabré, E. Fontich, R. de la Llave, J. Differ.
Equations 218 (2005) 444 (parametrisation method).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import NDArray

from rattle.errors import RattleError, require
from rattle.flight.law import folded
from rattle.orbits.images import images
from rattle.orbits.periodic import Periodic
from rattle.orbits.return_map import power_map

Array = NDArray[np.float64]
DEGREE, NODES = 10, 25
LARGEST, SMALLEST = 0.1, 1e-9  # sizes of s that are tried
RESIDUAL, ROUNDING = 1e-12, (4e-15, 8e-15)  # of F(W(s)) − W(λs): of the size; at least, of v, forwards and back
MOST_ITERATIONS = 60


@dataclass(frozen=True)
class Local:
    """W(s) for |s| ≤ size: powers (DEGREE + 1, 2) of s/size of (τ, v).

    Multiplier λ of F, which is `steps` impacts on Σ⁺, forwards or backwards, in `turns` forcing periods. residual:
    largest |F(W(s/λ)) − W(s)|.
    """

    orbit: Periodic
    backwards: bool
    powers: Array
    size: float
    multiplier: float
    steps: int
    turns: int
    residual: float = np.inf
    unit: float = 1.0  # of speeds, in residuals

    def at(self, s: Array) -> Array:
        """States (2, n) (τ not folded, v) at |s| ≤ size (n,)."""
        return np.asarray(polyval(np.asarray(s) / self.size, self.powers), np.float64)

    def map(self, states: Array, times: int) -> tuple[NDArray[np.bool_], Array, NDArray[np.int64], NDArray[np.int64]]:
        """F^times of states (2, n): which exist (n,), images (2, n), word and number of impacts on Σ⁻ (n,)."""
        tau, v = (np.ascontiguousarray(x) for x in states)
        steps, turns = times * self.steps, times * self.turns
        ok, tau, v, word, bounces = images(tau, v, steps, turns, self.backwards, self.orbit.point)
        return ok, np.stack([tau, v]), word, bounces

    def image(self, s: Array, times: int) -> tuple[NDArray[np.bool_], Array, NDArray[np.int64], NDArray[np.int64]]:
        """F^times(W(s)) for any s (n,), as `map`."""
        more = max(0, int(np.ceil(np.log(np.abs(s).max() / self.size) / np.log(self.multiplier))))
        return self.map(self.at(s / self.multiplier**more), times + more)


def tangent(orbit: Periodic) -> Array:
    """DΠ^k (2, 2) of the orbit in (τ, v); infinite at a graze."""
    product, tau, v = np.eye(2), float(folded(orbit.tau)), orbit.v
    for _ in range(orbit.label[1]):
        found = power_map(tau, v, 1, orbit.point)
        tau, v = found[1:3]
        product = np.array(found[5:9]).reshape(2, 2) @ product
    return product


def eigenvectors(orbit: Periodic) -> tuple[Array, Array]:
    """Return the unit eigenvectors (2,) in (τ, v) of the unstable and the stable multiplier.

    Returns
    -------
    tuple[Array, Array]
        Both towards rising v (rising τ where v does not change).
    """
    values, vectors = np.linalg.eig(tangent(orbit))
    unstable, stable = (np.real(vectors[:, i]) for i in np.argsort(-np.abs(values)))
    unstable, stable = (x * np.sign(x[1] if abs(x[1]) > 1e-9 else x[0]) for x in (unstable, stable))
    return unstable, stable


def local_manifold(orbit: Periodic, stable: bool, unit: float = 1.0) -> Local:
    """Return the local manifold of a saddle.

    It reaches as far as a series of degree 10 has a residual of 1e-12 of its size, v counted in units of this speed.

    Returns
    -------
    Local
        Coefficients of the series, and how far it holds.

    Raises
    ------
    ParameterError
        If the orbit is no saddle.
    RattleError
        If it is too close to grazing.
    """
    large, small = orbit.multipliers
    saddle = orbit.admissible and np.isfinite(large) and abs(large) > 1.0 > abs(small) > 0.0
    require(bool(saddle), f"the orbit is no saddle with finite multipliers: {large}, {small}")
    multiplier = float(1.0 / np.real(small) if stable else np.real(large))
    twice = 2 if multiplier < 0 else 1
    multiplier **= twice
    powers = np.zeros((DEGREE + 1, 2))
    powers[0], powers[1] = (orbit.tau, orbit.v), eigenvectors(orbit)[1 if stable else 0]
    size = LARGEST
    derivative = np.linalg.matrix_power(tangent(orbit), -twice if stable else twice)
    scaled = derivative * [[1.0, unit], [1.0 / unit, 1.0]]
    rounding = ROUNDING[stable] * max(1.0, orbit.v / unit) * max(1.0, float(np.linalg.norm(scaled)))
    while size > SMALLEST:
        start = Local(orbit, stable, powers, 1.0, multiplier, twice * orbit.label[1], twice * orbit.m, unit=unit)
        found = _solved(start, size, np.asarray(derivative, np.float64))
        if found is not None and found.residual < max(rounding, RESIDUAL * size * max(1.0, multiplier / 10.0)):
            return found
        size /= 2.0
    raise RattleError(f"the saddle at tau = {orbit.tau}, v = {orbit.v} is too close to grazing for a local manifold")


def _solved(start: Local, size: float, derivative: Array) -> Local | None:
    """Return the series on |s| ≤ size with both lowest powers held; None if Γ is in the way.

    Order by order W_k changes by (λ^k − DF)⁻¹ of the residual's power k, which is Newton's step but for the bend of F.

    Returns
    -------
    Local | None
        The series, or None.
    """
    x = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
    solve = np.linalg.pinv(np.vander(x, DEGREE + 1, increasing=True)[:, 2:])
    rates = start.multiplier ** np.arange(2, DEGREE + 1)
    inverse = np.linalg.inv(rates[:, None, None] * np.eye(2) - derivative)
    powers = start.powers * np.array([1.0, size] + [0.0] * (DEGREE - 1))[:, None]
    local, last = replace(start, powers=powers, size=size), np.inf
    for _ in range(MOST_ITERATIONS):
        before = local.at(size * x / local.multiplier)
        if not (before[1] > 0).all():
            return None
        ok, states, word, _ = local.map(before, 1)
        if not (ok.all() and (word == word[0]).all()):
            return None
        off = states - local.at(size * x)
        local = replace(local, residual=float((np.abs(off) / [[1.0], [local.unit]]).max()))
        new = local.powers.copy()  # off is of F(W(s/λ)) − W(s), so its power k is that of F(W(s)) − W(λs) over λ^k
        new[2:] += np.einsum("kij,kj->ki", inverse * rates[:, None, None], solve @ off.T)
        change = float((np.abs(new - local.powers) / [1.0, local.unit]).max())
        if change < 1e-16 or (
            local.residual < ROUNDING[start.backwards] * start.orbit.v / start.unit and change >= last
        ):
            break
        if not change < 1.0:
            return None
        local, last = replace(local, powers=new), change
    return local
