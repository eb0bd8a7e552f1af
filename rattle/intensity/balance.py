"""Check the accuracy of many attractors by the balance of their impulses.

The forcing has mean zero and Φ' returns to its value, so the impacts of a bounded motion balance the drift: the sum of
the impulses on Σ⁺ minus the sum of those on Σ⁻ is 4πδ per forcing period, and 4πδ(1 + load) with a load. This balance
is exact over a period of a periodic motion. Over T forcing periods of any other motion half of the difference deviates
from 2πδ by less than (largest speed)/T.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.attractors.table import AttractorTable
from rattle.flight.first_impact import OK
from rattle.intensity.motions import ENDLESS, one_period_limits
from rattle.intensity.visit import COLUMNS, IMPULSE, TIME, mean_contact_force_at_point, sum_impacts
from rattle.numerics.compile import kernel
from rattle.orbits.return_map import point_of_cell

# a chaotic motion is followed for PERIODS forcing periods, or for RELAXATIONS/δ if this is more
PERIODS, RELAXATIONS = 64.0, 8.0
MOST_IMPACTS = 1_000_000


@kernel
def write_impulse_imbalances(cell, returns, periods, tau, v, cells, sums, errors):
    """Write the relative error of each motion's impulse balance to `errors` (n,); NaN if the motion cannot be followed.

    Each motion is followed for returns[i] returns to Σ⁺ or periods[i] forcing periods, whichever ends first. If both
    limits are infinite, the motion is followed for PERIODS forcing periods, or RELAXATIONS/δ if this is more. `sums`
    (1, COLUMNS) is scratch memory.
    """
    for i in range(cell.size):
        point = point_of_cell(cell[i], cells)
        sums[:] = 0.0
        most = periods[i]
        if returns[i] == ENDLESS and most == math.inf:
            most = max(PERIODS, RELAXATIONS / point.delta)
        status, _tau, _v, _time = sum_impacts(tau[i], v[i], returns[i], most, MOST_IMPACTS, point, sums)
        balance = 0.5 * sums[0, IMPULSE] / (0.5 * mean_contact_force_at_point(point) * sums[0, TIME])
        errors[i] = abs(balance - 1.0) if status == OK else math.nan


def impulse_balance_errors(table: AttractorTable, cells: Any) -> NDArray[np.float64]:
    """Return the relative error |(P₊ − P₋)/(4πδT) − 1| of the impulse balance of every attractor of a table (n,).

    P₊ and P₋ are the sums of the impulses on Σ⁺ and on Σ⁻ during T forcing periods. With a load 4πδ is replaced by
    4πδ(1 + load). A periodic attractor is followed over one period, so its error is rounding only. A chaotic attractor
    is followed for 64 forcing periods, or 8/δ if this is more.

    Parameters
    ----------
    cells : Any
        The record of cells, as kernels take it.

    Returns
    -------
    NDArray[np.float64]
        The errors; NaN for attractors that are neither periodic nor chaotic, or cannot be followed.
    """
    errors = np.full(table.cell.size, np.nan)
    rows = np.flatnonzero((table.kind == Outcome.PERIODIC) | (table.kind == Outcome.CHAOTIC))
    found = np.empty(rows.size)
    returns, periods = one_period_limits(table.m, table.n_plus, table.contacts)
    returns = np.where(table.kind == Outcome.PERIODIC, returns, ENDLESS)
    columns = (x[rows] for x in (table.cell, returns, periods, table.tau, table.v))
    write_impulse_imbalances(*columns, cells, np.zeros((1, COLUMNS)), found)
    errors[rows] = found
    return errors
