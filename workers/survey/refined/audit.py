"""Audit a refined survey: compute a random share of the filled cells, and so bound the share of wrong filled cells."""

from collections.abc import Sequence

import numpy as np

from gear_rattle.workers.survey.refined.blocks import Blocks
from gear_rattle.workers.survey.refined.evidence import scrambled

SOURCE_LEVEL, AUDIT, LEAF = "source_level", "audit", "audit_leaf"  # variables of an audit
AUDITED, DISAGREED = 1, 2  # codes of an audited cell; 0 for other cells
SURE = 0.95  # confidence of the bound
#: Attributes of a store: how many cells were filled, how many of them the audit computed, how many of these were wrong,
#: and the upper bound of the share of wrong cells among the filled cells.
TOLD = "refined_cells_filled", "refined_cells_audited", "refined_cells_disagreed", "refined_wrong_share_upper"

#: Attribute of the store of a survey with a bound: the rounds of audits after the first round, as JSON.
ROUNDS = "refined_rounds"


def draws(blocks: Blocks, seed: int) -> np.ndarray:
    """Return a random number for each cell of the frame (cells,): the cells with the smallest numbers are audited.

    The number of a cell depends only on the seed and on the cell's position in the grid.

    Returns
    -------
    np.ndarray
        float64, uniformly distributed in [0, 1).
    """
    rows, columns = (np.arange(span.start, span.stop, dtype=np.uint64) for span in blocks.frame)
    place = (rows[:, None] << np.uint64(32)) + columns
    drawn = scrambled(place ^ scrambled(np.full(1, seed, np.uint64)))
    found: np.ndarray = (drawn >> np.uint64(11)).astype(float) * 2.0**-53
    return found.ravel()


def told_of_audit(counts: Sequence[Sequence[int]]) -> dict[str, int | float]:
    """Return the attributes TOLD of a store. counts: the numbers of filled, audited and wrong cells of each slice.

    All slices audit the same positions, so the audits of several slices are no larger a sample than that of one. The
    bound for the survey is therefore the largest bound of a slice; it is 0 if no cells are filled.

    Returns
    -------
    dict[str, int | float]
        Value of each attribute.
    """
    upper = max(upper_share(disagreed, audited) if filled else 0.0 for filled, audited, disagreed in counts)
    return dict(zip(TOLD, (*map(sum, zip(*counts, strict=True)), upper), strict=True))


def upper_share(wrong: int, of: int, sure: float = SURE) -> float:
    """Return an upper bound of the share of wrong cells, with confidence `sure`.

    of: the number of cells that were drawn at random. wrong: how many of these cells are wrong. The bound is the upper
    end of the one-sided interval of Clopper and Pearson, Biometrika 26 (1934) 404.

    Returns
    -------
    float
        1 if `of` is 0.
    """
    from scipy.special import betaincinv  # imported here, because it takes a tenth of a second to load

    return float(betaincinv(wrong + 1, of - wrong, sure)) if wrong < of else 1.0
