"""Powers of a return map with their tangent map, and the periodic orbits that Newton's method finds (compiled).

The type of a parameter point or of a record of cells selects the model: by this type kernels find the functions of this
table (`rattle.numerics.compile.implement_for_type`). Each gear provides all these functions for its point and its
cells, in `rattle.impacting`, `rattle.stiff` and `rattle.inelastic`; the inelastic gear has no inverse map:

===========================  =================  ==================  =================  =========
function                     declared in        impacting           stiff              inelastic
===========================  =================  ==================  =================  =========
step                         orbits.return_map  map.impact_map      map.return_map     map.impact_map
step_with_tangent            orbits.return_map  map.impact_map      map.return_map     map.impact_map
inverse_step                 orbits.return_map  map.impact_map      map.return_map     none
follow_to_next_departure     intensity.visit    map.impact_map      map.return_map     map.bounce
mean_contact_force_at_point  intensity.visit    map.impact_map      map.return_map     map.bounce
point_of_cell                orbits.return_map  attractors.settle   attractors.settle  map.cells
point_between                orbits.return_map  attractors.settle   attractors.settle  map.cells
===========================  =================  ==================  =================  =========
"""

import math

from rattle.flight.first_impact import OK
from rattle.flight.law import fold_phase, speed_unit, wrap_phase_difference
from rattle.numerics.compile import kernel

NEWTON_STEPS = 15
# an orbit counts as closed if a state and its image differ by less than this, in forcing periods and in units of
# `speed_unit`
SAME = 1e-8


def step(tau, v, point):
    """Apply Π to (τ, v), and return (status, τ', v', elapsed time, number of contacts with Σ⁻)."""
    raise NotImplementedError("this function exists inside kernels only: from Python use Gear.iterate")


def step_with_tangent(tau, v, point):
    """Apply Π and its tangent map; return (status, τ', v', time, contacts with Σ⁻, j00, j01, j10, j11, ln|det|)."""
    raise NotImplementedError("this function exists inside kernels only: from Python use Gear.iterate")


def inverse_step(tau, v, point):
    """Apply Π⁻¹ to (τ, v), and return (status, τ', v', elapsed time, number of contacts with Σ⁻)."""
    raise NotImplementedError("this function exists inside kernels only: from Python use Gear.inverse_impact")


def point_of_cell(cell, cells):
    """Return the parameter point of cell number `cell` of a record of cells."""
    raise NotImplementedError("point_of_cell exists inside kernels only")


def point_between(share, one, other):
    """Return the parameter point at `share` of the way from the point `one` to the point `other`."""
    raise NotImplementedError("point_between exists inside kernels only")


@kernel
def apply_return_map_power(tau, v, k, point):
    """Apply Π^k and its tangent map; return (status, τ', v', time, impacts on Σ⁻, j00, j01, j10, j11, ln|det|)."""
    a00, a01, a10, a11, log_det, time, n_minus = 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0
    for _ in range(k):
        status, tau, v, s, below, j00, j01, j10, j11, ln = step_with_tangent(tau, v, point)
        if status != OK:
            return status, tau, v, time, n_minus, a00, a01, a10, a11, log_det
        a00, a10 = j00 * a00 + j01 * a10, j10 * a00 + j11 * a10
        a01, a11 = j00 * a01 + j01 * a11, j10 * a01 + j11 * a11
        log_det += ln
        time += s
        n_minus += below
    return OK, tau, v, time, n_minus, a00, a01, a10, a11, log_det


@kernel
def find_fixed_point(tau, v, k, point):
    """Find the fixed point of Π^k near (τ, v) by Newton's method, and return (found, τ, v)."""
    size, unit = 1.0, speed_unit(point.delta, point.epsilon, point.beta)
    for _ in range(NEWTON_STEPS):
        status, t1, v1, _time, _below, a00, a01, a10, a11, _ln = apply_return_map_power(tau, v, k, point)
        if status != OK:
            return False, tau, v
        r0, r1 = wrap_phase_difference(t1 - tau), v1 - v
        determinant = (a00 - 1.0) * (a11 - 1.0) - a01 * a10
        if determinant == 0.0:
            return False, tau, v
        d0 = -((a11 - 1.0) * r0 - a01 * r1) / determinant
        d1 = -((a00 - 1.0) * r1 - a10 * r0) / determinant
        last, size = size, max(abs(d0), abs(d1) / unit)
        if not size < 0.1:
            return False, tau, v
        tau = fold_phase(tau + d0)
        v += d1
        if not v > 0.0:
            return False, tau, v
        if size < 1e-13 or (size < 1e-9 and size >= 0.5 * last):  # converged to rounding
            return True, tau, v
    return False, tau, v


@kernel
def log_multipliers(trace, log_det):
    """Return ln|λ| of both multipliers λ of a tangent map with this trace and ln|det|, the larger first."""
    determinant = math.exp(log_det)
    inside = 0.25 * trace * trace - determinant
    if inside <= 0.0:
        return 0.5 * log_det, 0.5 * log_det
    first = math.log(abs(0.5 * trace) + math.sqrt(inside))
    return first, log_det - first


@kernel
def least_return_period(tau, v, k, point):
    """Return the least divisor d of k with Π^d(τ, v) = (τ, v) up to rounding; k if there is none."""
    t, speed, unit = tau, v, speed_unit(point.delta, point.epsilon, point.beta)
    for d in range(1, k // 2 + 1):
        status, t, speed, _time, _below = step(t, speed, point)
        if status != OK:
            break
        if k % d == 0 and abs(wrap_phase_difference(t - tau)) < SAME and abs(speed - v) < SAME * unit:
            return d
    return k


@kernel
def fastest_departure(tau, v, k, point):
    """Return (τ, v) after the fastest of the k impacts on Σ⁺ of a periodic orbit; this state identifies the orbit."""
    best_tau, best_v = tau, v
    for _ in range(k):
        _status, tau, v, _time, _below = step(tau, v, point)
        if v > best_v:
            best_tau, best_v = tau, v
    return best_tau, best_v
