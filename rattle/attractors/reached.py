"""Which attractor each of some states goes to."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.basins import Plane, classified
from rattle.attractors.table import CHAOTIC, MOST_SAMPLES, UNDECIDED, Attractor, Attractors, listed
from rattle.errors import ParameterError, real_array, require
from rattle.orbits.iterates import fold


@dataclass(frozen=True)
class Reached:
    """Where states went. attractors: by falling share of the states. which: index into them, of the shape of the
    states. impacts: on Σ⁺ until the end of each was certain, −1 of chaotic and undecided ones.
    """

    attractors: tuple[Attractor, ...]
    which: NDArray[np.int64]
    impacts: NDArray[np.int64]


def states_of(tau: ArrayLike, v: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, ...]]:
    """Flat phases in [0, 1) and speeds above 0 of states that broadcast, and their shape. Raises ParameterError."""
    try:
        phases, speeds = np.broadcast_arrays(real_array("tau", tau), real_array("v", v))
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(f"tau and v must broadcast: {error}") from None
    require(phases.size > 0, "there must be a state at least")
    require(phases.size <= MOST_SAMPLES, f"{phases.size} states are too many at once: at most {MOST_SAMPLES}")
    require(bool(np.isfinite(phases).all()), "tau must be finite")
    require(bool((np.isfinite(speeds) & (speeds > 0.0)).all()), "v must be finite and greater than 0")
    return fold(phases.ravel()), speeds.astype(np.float64).ravel(), phases.shape


def reached(plane: Plane, tau: ArrayLike, v: ArrayLike) -> Reached:
    """See `rattle.Gear.reached`."""
    phases, speeds, shape = states_of(tau, v)
    table, rows, impacts = classified(plane, phases, speeds)
    count = np.bincount(rows, minlength=table.kind.size)
    order = np.lexsort((np.arange(count.size), -count))
    number = np.argsort(order)
    found = listed(Attractors._make(x[order] for x in table), count[order])
    kind = table.kind[rows]
    impacts = np.where((kind == CHAOTIC) | (kind == UNDECIDED), -1, impacts)
    return Reached(found, number[rows].reshape(shape), impacts.reshape(shape))
