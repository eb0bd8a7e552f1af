"""A ball around a stable periodic point from which every trajectory goes to it (compiled).

DΠ^k at the point contracts in the norm zᵀMz that solves M − JᵀMJ/ρ² = Q, with ρ between the spectral radius and 1. The
ball is grown as long as, on its rim and half way to it, Π^k makes as many impacts on Σ⁻ as the orbit and its tangent
contracts in that norm; half the largest such radius is used. Where Π^k is smooth and DΠ^k contracts on a convex set
around its fixed point, the set is mapped into itself and shrinks to the point. docs/decisions/0007-survey-cost.md says
what this assumes between the directions that are looked at, and how it is tested.
"""

import math

from rattle.flight.first_impact import OK
from rattle.flight.law import speed_unit
from rattle.numerics.compile import kernel
from rattle.orbits.return_map import power_map

LARGEST, SMALLEST = 0.25, 1e-5  # radii in phase that are tried, halving
SPEED_WEIGHT = 1.0 / 16.0  # (Δτ)² + (Δv)²/16: phases are of order 1, speeds of order 4 units
DIRECTIONS = 8


@kernel
def contracting_norm(a, b, c, d, q):
    """M of the norm in which [[a, b], [c, d]] contracts, with Q = diag(1, q): (found, m00, m01, m11)."""
    determinant, trace = a * d - b * c, a + d
    inside = 0.25 * trace * trace - determinant
    radius = math.sqrt(abs(determinant)) if inside <= 0.0 else abs(0.5 * trace) + math.sqrt(inside)
    if not radius < 1.0:
        return False, 0.0, 0.0, 0.0
    r = 2.0 / (1.0 + radius * radius)  # 1/ρ², half way to 1
    k00, k01, k02 = 1.0 - r * a * a, -2.0 * r * a * c, -r * c * c
    k10, k11, k12 = -r * a * b, 1.0 - r * (a * d + b * c), -r * c * d
    k20, k21, k22 = -r * b * b, -2.0 * r * b * d, 1.0 - r * d * d
    # Cramer's rule with right-hand side (1, 0, q)
    whole = k00 * (k11 * k22 - k12 * k21) - k01 * (k10 * k22 - k12 * k20) + k02 * (k10 * k21 - k11 * k20)
    m00 = (k11 * k22 - k12 * k21) + q * (k01 * k12 - k02 * k11)
    m01 = -(k10 * k22 - k12 * k20) - q * (k00 * k12 - k02 * k10)
    m11 = (k10 * k21 - k11 * k20) + q * (k00 * k11 - k01 * k10)
    return True, m00 / whole, m01 / whole, m11 / whole


@kernel
def contracts(tau, v, k, n_minus, m00, m01, m11, point):
    """True if Π^k at this state has as many Σ⁻ impacts as the orbit and a tangent that contracts in the norm M."""
    if not v > 0.0:
        return False
    status, _t, _v, _time, below, a, b, c, d, _ln = power_map(tau - math.floor(tau), v, k, point)
    if status != OK or below != n_minus:
        return False
    n00 = a * (m00 * a + m01 * c) + c * (m01 * a + m11 * c)
    n01 = a * (m00 * b + m01 * d) + c * (m01 * b + m11 * d)
    n11 = b * (m00 * b + m01 * d) + d * (m01 * b + m11 * d)
    whole = m00 * m11 - m01 * m01
    trace = (m11 * n00 - 2.0 * m01 * n01 + m00 * n11) / whole
    determinant = (n00 * n11 - n01 * n01) / whole
    return trace < 2.0 and trace < 1.0 + determinant  # both eigenvalues of M⁻¹ DᵀMD below 1


@kernel
def ball(tau, v, k, n_minus, point):
    """The quadratic form whose value below 1 means capture by the fixed point (τ, v) of Π^k: (found, c00, c01, c11)."""
    status, _t, _v, _time, _below, a, b, c, d, _ln = power_map(tau, v, k, point)
    unit = speed_unit(point.delta, point.epsilon, point.beta)
    found, m00, m01, m11 = contracting_norm(a, b, c, d, SPEED_WEIGHT / (unit * unit))
    if status != OK or not (found and m00 > 0.0 and m00 * m11 > m01 * m01):
        return False, 0.0, 0.0, 0.0
    radius = LARGEST
    while radius > SMALLEST:
        good = True
        for i in range(2 * DIRECTIONS):
            angle = math.pi * i / DIRECTIONS
            size = radius if i % 2 == 0 else 0.5 * radius
            # (x, y) on the ellipse zᵀMz = size², by the Cholesky factor of M
            y = size * math.sin(angle) / math.sqrt(m11 - m01 * m01 / m00)
            x = size * math.cos(angle) / math.sqrt(m00) - m01 * y / m00
            if not contracts(tau + x, v + y, k, n_minus, m00, m01, m11, point):
                good = False
                break
        if good:
            scale = 4.0 / (radius * radius)
            return True, scale * m00, scale * m01, scale * m11
        radius *= 0.5
    return False, 0.0, 0.0, 0.0
