"""Capture regions: neighbourhoods of stable periodic points from which every trajectory converges (compiled).

The tangent map J = DΠ^k at the point contracts in the norm zᵀMz, where M solves M − JᵀMJ/ρ² = Q with a diagonal matrix
Q, and ρ lies between the spectral radius of J and 1. The region is the ellipse zᵀMz < radius². Its radius is half the
largest tried radius with two properties, which are checked in several directions on the ellipse of that radius and on
the ellipse of half that radius: Π^k makes as many impacts on Σ⁻ as the orbit does, and DΠ^k contracts in that norm.

Where Π^k is smooth and DΠ^k contracts on a convex set around its fixed point, the set is mapped into itself and shrinks
to the point. The conditions are assumed to hold between the sampled directions too; docs/decisions/0007-survey-cost.md
says how this assumption is tested.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import KnownOrbits
from rattle.flight.first_impact import OK
from rattle.flight.law import speed_unit
from rattle.numerics.compile import inline, kernel
from rattle.orbits.return_map import apply_return_map_power, point_of_cell, step

# LARGEST: the first radius that is tried, in units of phase. Each later radius is half the previous one, as long as it
# is larger than SMALLEST.
LARGEST, SMALLEST = 0.25, 1e-5
# The squared distance of states is (Δτ)² + (Δv)²/16, with v in units of `speed_unit`, because phases are of order 1 and
# speeds of order 4 units.
SPEED_WEIGHT = 1.0 / 16.0
DIRECTIONS = 8  # number of directions in which the conditions are checked on each of the two ellipses
COSINES, SINES = (np.array([f(math.pi * i / DIRECTIONS) for i in range(2 * DIRECTIONS)]) for f in (math.cos, math.sin))
BALLS_PER_ORBIT = 4  # an orbit has capture regions around at most this many of its points


class CaptureCentres(NamedTuple):
    """Points (k,) of orbits around which capture regions are grown.

    Attributes
    ----------
    cell, orbit
        Number of the cell, and number of the orbit in the cell.
    n_plus, n_minus
        Impacts on Σ⁺ and on Σ⁻ in a period.
    tau, v
        State at the point.
    m00, m01, m11
        The matrix M of the norm.
    radius
        Radius of the outer ellipse on which the conditions are checked, twice that of the capture region. Before the
        search this is the largest radius to try, and after it the largest tried radius at which the conditions hold,
        0 if they hold at none.
    """

    cell: Any
    orbit: Any
    n_plus: Any
    n_minus: Any
    tau: Any
    v: Any
    m00: Any
    m01: Any
    m11: Any
    radius: Any


@kernel
def contracting_norm(a, b, c, d, q):
    """Return the matrix M of a norm zᵀMz in which J = [[a, b], [c, d]] contracts.

    M solves M − JᵀMJ/ρ² = diag(1, q), with ρ² half-way between 1 and the square of the spectral radius of J.

    Returns
    -------
    tuple[bool, float, float, float]
        (found, m00, m01, m11); `found` is False if the spectral radius of J is not below 1.
    """
    determinant, trace = a * d - b * c, a + d
    inside = 0.25 * trace * trace - determinant
    radius = math.sqrt(abs(determinant)) if inside <= 0.0 else abs(0.5 * trace) + math.sqrt(inside)
    if not radius < 1.0:
        return False, 0.0, 0.0, 0.0
    r = 2.0 / (1.0 + radius * radius)  # 1/ρ², with ρ² half-way between the square of the spectral radius and 1
    k00, k01, k02 = 1.0 - r * a * a, -2.0 * r * a * c, -r * c * c
    k10, k11, k12 = -r * a * b, 1.0 - r * (a * d + b * c), -r * c * d
    k20, k21, k22 = -r * b * b, -2.0 * r * b * d, 1.0 - r * d * d
    # Cramer's rule for M with the right-hand side (1, 0, q)
    whole = k00 * (k11 * k22 - k12 * k21) - k01 * (k10 * k22 - k12 * k20) + k02 * (k10 * k21 - k11 * k20)
    m00 = (k11 * k22 - k12 * k21) + q * (k01 * k12 - k02 * k11)
    m01 = -(k10 * k22 - k12 * k20) - q * (k00 * k12 - k02 * k10)
    m11 = (k10 * k21 - k11 * k20) + q * (k00 * k11 - k01 * k10)
    return True, m00 / whole, m01 / whole, m11 / whole


@inline
def is_contraction(a, b, c, d, m00, m01, m11):
    """Return whether the matrix J = [[a, b], [c, d]] contracts in the norm zᵀMz, M = [[m00, m01], [m01, m11]]."""
    n00 = a * (m00 * a + m01 * c) + c * (m01 * a + m11 * c)
    n01 = a * (m00 * b + m01 * d) + c * (m01 * b + m11 * d)
    n11 = b * (m00 * b + m01 * d) + d * (m01 * b + m11 * d)
    whole = m00 * m11 - m01 * m01
    trace = (m11 * n00 - 2.0 * m01 * n01 + m00 * n11) / whole
    determinant = (n00 * n11 - n01 * n01) / whole
    return trace < 2.0 and trace < 1.0 + determinant  # both eigenvalues of M⁻¹ JᵀMJ are below 1


@inline
def state_on_ellipse(centres, i, direction, radius):
    """Return the state in direction number `direction` from centre i, on an ellipse zᵀMz = size² around the centre.

    z is the difference from the centre, and M the matrix of the centre's norm. The size is `radius` if `direction` is
    even, and half the radius if it is odd.

    Returns
    -------
    tuple[float, float]
        Phase and speed.
    """
    m00, m01, m11 = centres.m00[i], centres.m01[i], centres.m11[i]
    size = radius if direction % 2 == 0 else 0.5 * radius
    y = size * SINES[direction] / math.sqrt(m11 - m01 * m01 / m00)
    x = size * COSINES[direction] / math.sqrt(m00) - m01 * y / m00
    tau = centres.tau[i] + x
    return tau - math.floor(tau), centres.v[i] + y


@kernel
def is_contracting_at(tau, v, i, centres, point):
    """Return whether the state (τ, v) meets the conditions for the capture region around centre i.

    With k impacts on Σ⁺ in a period of the centre's orbit, Π^k must make as many impacts on Σ⁻ as the orbit does, and
    its tangent map must contract in the centre's norm.

    Returns
    -------
    bool
        False also where v ≤ 0 or Π^k is not defined.
    """
    if not v > 0.0:
        return False
    status, _t, _v, _time, below, a, b, c, d, _ln = apply_return_map_power(tau, v, centres.n_plus[i], point)
    same = status == OK and below == centres.n_minus[i]
    return same and is_contraction(a, b, c, d, centres.m00[i], centres.m01[i], centres.m11[i])


@kernel
def find_capture_radii_one_by_one(centres, cells):
    """Reduce `centres.radius` to the largest radii at which the conditions hold, computing flights one by one."""
    for i in range(centres.radius.size):
        point = point_of_cell(centres.cell[i], cells)
        direction = 0
        while centres.radius[i] > 0.0 and direction < 2 * DIRECTIONS:
            tau, v = state_on_ellipse(centres, i, direction, centres.radius[i])
            direction += 1
            if not is_contracting_at(tau, v, i, centres, point):
                centres.radius[i], direction = next_capture_radius(centres.radius[i]), 0


@inline
def next_capture_radius(radius):
    """Return the next radius to try: half the radius, or 0 if the half is not above SMALLEST."""
    return 0.5 * radius if 0.5 * radius > SMALLEST else 0.0


@inline
def impacts_between_centres(n_plus):
    """Return the number of impacts on Σ⁺ from one centre of an orbit to the next; a period has n_plus impacts on Σ⁺."""
    return (n_plus + BALLS_PER_ORBIT - 1) // BALLS_PER_ORBIT


@kernel
def fill_capture_centres(grown, orbits, cells, integers, floats):
    """Compute the columns of the `CaptureCentres` that `centres_of_new_regions` returns, in compiled code.

    grown, orbits, cells: as in `centres_of_new_regions`. integers (4, n): receives the columns `cell` to `n_minus`.
    floats (6, n): receives the columns `tau` to `radius`.
    """
    n = 0
    for cell in range(grown.size):
        for j in range(grown[cell], orbits.n[cell]):
            if orbits.first[cell, j] == -math.inf:
                continue
            point = point_of_cell(cell, cells)
            n_plus, tau, v = orbits.n_plus[cell, j], orbits.tau[cell, j], orbits.v[cell, j]
            every = impacts_between_centres(n_plus)
            unit = speed_unit(point.delta, point.epsilon, point.beta)
            for i in range(n_plus):
                if i % every == 0:
                    status, _t, _v, _time, _below, a, b, c, d, _ln = apply_return_map_power(tau, v, n_plus, point)
                    found, m00, m01, m11 = contracting_norm(a, b, c, d, SPEED_WEIGHT / (unit * unit))
                    found = status == OK and found and m00 > 0.0 and m00 * m11 > m01 * m01
                    integers[0, n], integers[1, n], integers[2, n], integers[3, n] = (
                        cell,
                        j,
                        n_plus,
                        orbits.n_minus[cell, j],
                    )
                    floats[0, n], floats[1, n] = tau, v
                    floats[2, n], floats[3, n], floats[4, n] = m00, m01, m11
                    floats[5, n] = LARGEST if found else 0.0
                    n += 1
                if i // every * every + every < n_plus:  # after the last centre of the orbit no more steps are needed
                    _status, tau, v, _time, _below = step(tau, v, point)


def centres_of_new_regions(grown: NDArray[np.int64], orbits: KnownOrbits, cells: Any) -> CaptureCentres:
    """Return the centres of capture regions for all orbits that have no capture regions yet.

    grown (n_cells,): in cell i the first grown[i] orbits have capture regions.

    An orbit with contact phases needs no capture regions and has no centres: all samples that enter the same contact
    leave it in the same state.

    Returns
    -------
    CaptureCentres
        The centres. The radius of a centre is the largest radius to try; it is 0 where Π^k, with the k impacts on
        Σ⁺ of the orbit, does not contract.
    """
    number = np.arange(orbits.n_plus.shape[1])
    new = (number >= grown[:, None]) & (number < orbits.n[:, None])
    n_plus = orbits.n_plus[new & (orbits.first > -np.inf)]
    every = impacts_between_centres(n_plus)
    n = int(((n_plus + every - 1) // every).sum())
    integers, floats = np.zeros((4, n), np.int64), np.zeros((6, n))
    fill_capture_centres(grown, orbits.to_kernel_tuple(), cells, integers, floats)
    return CaptureCentres(*integers, *floats)


@kernel
def append_capture_regions(centres, balls):
    """Append the capture regions of these centres to the tables of their cells, which must have room."""
    for i in range(centres.radius.size):
        radius = centres.radius[i]
        if radius > 0.0:
            cell, scale = centres.cell[i], 4.0 / (radius * radius)
            p = balls.n[cell]
            balls.orbit[cell, p], balls.tau[cell, p], balls.v[cell, p] = centres.orbit[i], centres.tau[i], centres.v[i]
            balls.c00[cell, p], balls.c01[cell, p] = scale * centres.m00[i], scale * centres.m01[i]
            balls.c11[cell, p] = scale * centres.m11[i]
            balls.n[cell] = p + 1
