"""Lifetimes of chaotic transients above a crisis, and the crisis they point to; no manifolds in it."""

import numpy as np
from scipy.optimize import least_squares

from rattle.flight.first_impact import OK
from rattle.flight.forcing import DRIFT
from rattle.impacting.map.impact_map import apply_impact_map
from rattle.impacting.map.iterate import iterate
from rattle.impacting.orbits.period_one import orbits_at
from rattle.numerics.compile import kernel

SETTLE = 200  # impacts that bring a state near A's unstable side onto the chaotic set


@kernel
def escapes(tau, v, low, most, delta, epsilon, beta):
    """The impact on Σ⁺ at which each of flat arrays of states first leaves with a speed below `low`, most + 1 if none
    of the next `most` does.
    """
    out = np.full(tau.size, most + 1)
    for i in range(tau.size):
        t, w = tau[i], v[i]
        for j in range(most):
            status, t, w, _, _ = apply_impact_map(t, w, delta, epsilon, beta, DRIFT)
            if w < low or status != OK:
                out[i] = j + 1
                break
    return out


def lifetimes(delta, epsilon, count, most, seed):
    """Impacts on Σ⁺ (count,) that random states on the chaotic set stay; most + 1 for those that stay longer."""
    rng = np.random.default_rng([seed, round(epsilon * 1e12)])
    a = next(orbit for orbit in orbits_at(delta, epsilon, 0.6) if orbit.name == "A")
    tau, v = a.tau + rng.uniform(0.0, 0.02, count), a.v + rng.uniform(0.02, 0.05, count)
    near = iterate(delta, epsilon, tau, v, SETTLE)
    inside = near.v > 0.8 * a.v
    return escapes(near.tau[inside], near.v[inside], 0.8 * a.v, most, delta, epsilon, 0.6)


def crisis_of(delta, epsilon, count, most, seed):
    """(ε_c, its standard error, γ, its error, χ² per degree) of a fit of mean lifetimes C (ε − ε_c)^−γ at these ε."""
    mean, error = [], []
    for x in epsilon:
        times = lifetimes(delta, float(x), count, most, seed)
        gone = np.count_nonzero(times <= most)
        mean.append(np.minimum(times, most).sum() / gone)  # likeliest mean of exponential lifetimes cut at most
        error.append(1.0 / np.sqrt(gone))
    mean, error = np.array(mean), np.array(error)
    scale = epsilon[0]

    def residual(p):
        return (np.log(mean) - p[0] + p[1] * np.log((epsilon - scale) / 1e-5 + np.exp(p[2]))) / error

    # ε_c = ε₀ − 1e-5 exp(p₂): below all samples
    fit = least_squares(residual, [np.log(mean[-1]), 1.0, 0.0])
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    below = 1e-5 * np.exp(fit.x[2])
    degrees = epsilon.size - 3
    spread = max(1.0, 2 * fit.cost / degrees) ** 0.5
    return (
        scale - below,
        below * covariance[2, 2] ** 0.5 * spread,
        fit.x[1],
        covariance[1, 1] ** 0.5 * spread,
        2 * fit.cost / degrees,
    )
