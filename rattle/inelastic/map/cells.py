"""Cells of the inelastic gear as kernels take them, and the parameter point of each cell (compiled).

The zeros of the contact force, its bounds, and the limits of capture are computed once for each cell.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.flight.forcing import DRIFT
from rattle.inelastic.map.contact import chatter_capture_limit, quiet_invariant
from rattle.inelastic.map.harmonics import (
    AMPLITUDE,
    ORDER,
    forcing_derivative_bounds,
    harmonics_at_unit_epsilon,
    isolate_force_zeros,
    max_zero_count,
)
from rattle.inelastic.map.impact_map import InelasticPoint
from rattle.numerics.compile import implement_for_type, kernel
from rattle.orbits.return_map import point_between, point_of_cell


class InelasticCells(NamedTuple):
    """Parameters of cells (n,), the shape of the forcing that they have in common, and quantities computed from them.

    shape (3, K): the harmonics at ε = 1. zeros (n, room): the zeros of the contact force of each cell, of which the
    first zero_count (n,) are used. positive (n,): 1 if the contact force is positive at phase 0, else 0. third, capture
    and quiet_invariant (n,): as in `InelasticPoint`.
    """

    delta: Any
    epsilon: Any
    beta: Any
    restitution: Any
    load: Any
    shape: Any
    zeros: Any
    zero_count: Any
    positive: Any
    third: Any
    capture: Any
    quiet_invariant: Any


@kernel
def scale_harmonics(shape, epsilon):
    """Return the harmonics (3, K) of a forcing at eccentricity epsilon, from its shape (3, K) at ε = 1."""
    harmonics = shape.copy()
    harmonics[AMPLITUDE] *= epsilon
    return harmonics


@kernel
def fill_derived_cell_fields(cells):
    """Compute the fields of cells that follow from their parameters, from `zeros` to `quiet_invariant`, in place."""
    for i in range(cells.delta.size):
        delta, drift = cells.delta[i], DRIFT * (1.0 + cells.load[i])
        harmonics = scale_harmonics(cells.shape, cells.epsilon[i])
        count, positive = isolate_force_zeros(delta, drift, harmonics, cells.zeros[i])
        cells.zero_count[i], cells.positive[i] = count, 1 if positive else 0
        cells.third[i] = forcing_derivative_bounds(delta, harmonics).forcing_third_derivative
        cells.capture[i] = (
            chatter_capture_limit(delta, cells.restitution[i], harmonics) if cells.restitution[i] < 1.0 else 0.0
        )
        if count == 0 and positive:
            cells.quiet_invariant[i] = quiet_invariant(delta, drift, cells.beta[i], harmonics)


@kernel
def inelastic_point_of_cell(cell, cells):
    """Return the `InelasticPoint` of cell number `cell`."""
    return InelasticPoint(
        cells.delta[cell],
        cells.epsilon[cell],
        cells.beta[cell],
        cells.restitution[cell],
        DRIFT * (1.0 + cells.load[cell]),
        scale_harmonics(cells.shape, cells.epsilon[cell]),
        cells.zeros[cell, : cells.zero_count[cell]].copy(),
        cells.positive[cell] == 1,
        cells.third[cell],
        cells.capture[cell],
        cells.quiet_invariant[cell],
    )


@implement_for_type(point_of_cell, InelasticCells)
def _point_of_cell(cell, cells):
    return inelastic_point_of_cell(cell, cells)


@implement_for_type(point_between, InelasticPoint)
def _point_between(share, one, other):
    delta = one.delta + share * (other.delta - one.delta)
    harmonics = one.harmonics + share * (other.harmonics - one.harmonics)
    room = np.empty(2 * int(harmonics[ORDER].max()) + 2)
    count, positive = isolate_force_zeros(delta, one.drift, harmonics, room)
    quiet = count == 0 and positive
    return InelasticPoint(
        delta,
        one.epsilon + share * (other.epsilon - one.epsilon),
        one.beta,
        one.restitution,
        one.drift,
        harmonics,
        room[:count].copy(),
        positive,
        forcing_derivative_bounds(delta, harmonics).forcing_third_derivative,
        chatter_capture_limit(delta, one.restitution, harmonics) if one.restitution < 1.0 else 0.0,
        quiet_invariant(delta, one.drift, one.beta, harmonics) if quiet else 0.0,
    )


def make_inelastic_cells(
    delta: NDArray[np.float64],
    epsilon: NDArray[np.float64],
    beta: NDArray[np.float64],
    restitution: NDArray[np.float64],
    load: NDArray[np.float64],
    harmonics: Any = (),
) -> InelasticCells:
    """Return the record of cells that compiled code takes, from parameters (n,) and the harmonics besides the first."""
    return cells_of_forcing_shape(delta, epsilon, beta, restitution, load, harmonics_at_unit_epsilon(harmonics))


def cells_of_forcing_shape(
    delta: NDArray[np.float64],
    epsilon: NDArray[np.float64],
    beta: NDArray[np.float64],
    restitution: NDArray[np.float64],
    load: NDArray[np.float64],
    shape: NDArray[np.float64],
) -> InelasticCells:
    """Return the record of cells that compiled code takes, from parameters (n,) and the harmonics (3, K) at ε = 1."""
    n = delta.size
    given = {"delta": delta, "epsilon": epsilon, "beta": beta, "restitution": restitution, "load": load}
    cells = InelasticCells(
        **{name: np.ascontiguousarray(x, np.float64) for name, x in given.items()},
        shape=shape,
        zeros=np.zeros((n, max_zero_count(shape) + 2)),
        **{name: np.zeros(n, np.int64) for name in ("zero_count", "positive")},
        **{name: np.zeros(n) for name in ("third", "capture", "quiet_invariant")},
    )
    fill_derived_cell_fields(cells)
    return cells


def make_inelastic_point(
    delta: float, epsilon: float, beta: float, restitution: float, load: float, harmonics: Any = ()
) -> InelasticPoint:
    """Return the record `InelasticPoint` of one parameter point, for compiled code."""
    d, e, b, r, more = (np.array([x]) for x in (delta, epsilon, beta, restitution, load))
    return InelasticPoint(*inelastic_point_of_cell(0, make_inelastic_cells(d, e, b, r, more, harmonics)))
