"""Audit a refined survey: the cells computed though they could be filled, and the conclusions for the others."""

from collections.abc import Sequence

import numpy as np

from gear_rattle.workers.survey.refined.blocks import Blocks
from gear_rattle.workers.survey.refined.evidence import scrambled

SOURCE_LEVEL, AUDIT, LEAF = "source_level", "audit", "audit_leaf"  # the variables that tell of it
AUDITED, DISAGREED = 1, 2  # codes of an audited cell; 0: it was not
SURE = 0.95
#: Attributes of a store: numbers of cells that were filled and audited, and that disagreed; and a bound at 95 % of the
#: share of the filled ones that are wrong.
TOLD = "refined_cells_filled", "refined_cells_audited", "refined_cells_disagreed", "refined_wrong_share_upper"

#: Of a store with a bound: the rounds that all its tiles have to go through, those after the first, as JSON.
ROUNDS = "refined_rounds"


def draws(blocks: Blocks, seed: int) -> np.ndarray:
    """Return a number from 0 to 1 for each cell of the frame (cells,), by the seed and where it is in the grid.

    Those of the least are audited.

    Returns
    -------
    np.ndarray
        A number for each cell.
    """
    rows, columns = (np.arange(span.start, span.stop, dtype=np.uint64) for span in blocks.frame)
    place = (rows[:, None] << np.uint64(32)) + columns
    drawn = scrambled(place ^ scrambled(np.full(1, seed, np.uint64)))
    found: np.ndarray = (drawn >> np.uint64(11)).astype(float) * 2.0**-53
    return found.ravel()


def told_of_audit(counts: Sequence[Sequence[int]]) -> dict[str, int | float]:
    """Return the entries of a store, by the names of TOLD, about each slice's filled and audited cells.

    All slices audit the same places, so together they are no larger a sample: the bound is the largest of theirs. Where
    nothing is filled, nothing is wrong.

    Returns
    -------
    dict[str, int | float]
        The entry of each name.
    """
    upper = max(upper_share(disagreed, audited) if filled else 0.0 for filled, audited, disagreed in counts)
    return dict(zip(TOLD, (*map(sum, zip(*counts, strict=True)), upper), strict=True))


def upper_share(wrong: int, of: int, sure: float = SURE) -> float:
    """Return the upper end of a share's one-sided interval, 95 % sure (Clopper and Pearson, Biometrika 26 (1934) 404).

    1 where nothing was looked at.

    Returns
    -------
    float
        The upper end.
    """
    from scipy.special import betaincinv  # a tenth of a second to load

    return float(betaincinv(wrong + 1, of - wrong, sure)) if wrong < of else 1.0
