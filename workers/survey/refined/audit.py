"""Audit a refined survey: compute a random share of the filled cells, and bound the share of wrong ones."""

from collections.abc import Sequence

import numpy as np

from gear_rattle.workers.survey.refined.blocks import Blocks
from gear_rattle.workers.survey.refined.evidence import scrambled

SOURCE_LEVEL, AUDIT, LEAF = "source_level", "audit", "audit_leaf"  # variables of an audit
AUDITED, DISAGREED = 1, 2  # codes of an audited cell; 0 for other cells
SURE = 0.95
#: Attributes of a store: numbers of filled, audited and disagreeing cells, and the 95 % bound of the share of wrong
#: cells among the filled ones.
TOLD = "refined_cells_filled", "refined_cells_audited", "refined_cells_disagreed", "refined_wrong_share_upper"

#: Attribute of a store with a bound: the rounds of all its tiles after the first, as JSON.
ROUNDS = "refined_rounds"


def draws(blocks: Blocks, seed: int) -> np.ndarray:
    """Return a number from 0 to 1 for each cell of the frame (cells,), from the seed and its position in the grid.

    The cells with the smallest numbers are audited.

    Returns
    -------
    np.ndarray
        float64, uniformly distributed.
    """
    rows, columns = (np.arange(span.start, span.stop, dtype=np.uint64) for span in blocks.frame)
    place = (rows[:, None] << np.uint64(32)) + columns
    drawn = scrambled(place ^ scrambled(np.full(1, seed, np.uint64)))
    found: np.ndarray = (drawn >> np.uint64(11)).astype(float) * 2.0**-53
    return found.ravel()


def told_of_audit(counts: Sequence[Sequence[int]]) -> dict[str, int | float]:
    """Return the attributes of a store, by the names of TOLD, about the filled and audited cells of each slice.

    All slices audit the same positions, so together they are no larger a sample: the bound is the largest of theirs.
    Without filled cells it is 0.

    Returns
    -------
    dict[str, int | float]
        Value of each attribute.
    """
    upper = max(upper_share(disagreed, audited) if filled else 0.0 for filled, audited, disagreed in counts)
    return dict(zip(TOLD, (*map(sum, zip(*counts, strict=True)), upper), strict=True))


def upper_share(wrong: int, of: int, sure: float = SURE) -> float:
    """Return the upper end of a share's one-sided interval (Clopper and Pearson, Biometrika 26 (1934) 404).

    Returns
    -------
    float
        1 if `of` is 0.
    """
    from scipy.special import betaincinv  # a tenth of a second to load

    return float(betaincinv(wrong + 1, of - wrong, sure)) if wrong < of else 1.0
