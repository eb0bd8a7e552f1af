"""Load or compile kernels now, so that later calls do not pay for it."""

from typing import Any

import numpy as np

from rattle.attractors.classify import begun
from rattle.attractors.recurrence import mark_footprints
from rattle.attractors.samples import GRID
from rattle.impacting.attractors.classifier import attractors_of, cells_of
from rattle.impacting.attractors.stretch import stretch
from rattle.impacting.bifurcations.codimension_two import robust_chaos_interval
from rattle.impacting.gear import Gear
from rattle.impacting.orbits.period_one import grazing
from rattle.intensity.balance import impulse_balance_errors
from rattle.intensity.table import intensities_of, one_by_one

POINT = 0.6, 0.1, 0.6
COLUMNS = np.array([POINT[0]]), np.array([POINT[1]]), np.array([POINT[2]])


def warm_up(kappa: float | None = None) -> None:
    """Run every kernel that a survey needs: compiled in a quarter of a minute, or loaded from the disk cache at once.

    Of the impacting gear, or of the stiff one with this stiffness; without boundary distance, basins, Γ, manifolds and
    curves, which compile when first used.
    """
    if kappa is None:
        _impacting()
    else:
        _stiff(kappa)


def _impacting() -> None:
    Gear(*POINT).orbits()
    table, cells = attractors_of(*POINT, count=16), cells_of(*COLUMNS)
    impulse_balance_errors(table, cells)
    intensities_of(table, cells, stretch)
    _footprints(cells)
    grazing("G1", 0.6)
    robust_chaos_interval()


def _stiff(kappa: float) -> None:
    from rattle import stiff  # not for who has no use for it
    from rattle.stiff.attractors import classifier

    stiff.StiffGear(*POINT, kappa).orbits()
    cells = classifier.cells_of(*COLUMNS, np.array([kappa]))
    table = stiff.attractors_of(*POINT, kappa, count=16)
    impulse_balance_errors(table, cells)
    intensities_of(table, cells, one_by_one)
    _footprints(cells)


def _footprints(cells: Any) -> None:
    """What only cells need whose chaos seems to be of several attractors."""
    states = begun(np.zeros(1, np.int64), np.zeros(1), np.ones(1), 0)
    mark_footprints(np.arange(1), 1, cells, states, np.zeros((1, GRID), np.uint64))
