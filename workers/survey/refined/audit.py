"""Audit a refined survey: compute a random share of the filled cells, and so bound the share of wrong filled cells."""

from collections.abc import Sequence

import numpy as np

from gear_rattle.workers.survey.refined.blocks import Blocks
from gear_rattle.workers.survey.refined.evidence import splitmix64

SOURCE_LEVEL, AUDIT, LEAF = "source_level", "audit", "audit_leaf"  # names of stored variables about audits
AUDITED, DISAGREED = 1, 2  # codes of an audited cell; 0 for other cells
CONFIDENCE = 0.95  # probability with which an upper bound of the share of wrong cells holds
#: Attributes of a store: how many cells were filled, how many of the filled cells the audit computed, how many of the
#: audited cells were wrong, and the upper bound of the share of wrong cells among the filled cells.
AUDIT_ATTRIBUTES = (
    "refined_cells_filled",
    "refined_cells_audited",
    "refined_cells_disagreed",
    "refined_wrong_share_upper",
)

#: Attribute of the store of a survey with a bound: the rounds of audits after the first round, as JSON.
ROUNDS = "refined_rounds"


def random_numbers_of_cells(blocks: Blocks, seed: int) -> np.ndarray:
    """Return a random number for each cell of a frame (see `Blocks`); cells with the smallest numbers are audited.

    The number of a cell depends only on the seed and on the cell's position in the grid.

    Returns
    -------
    np.ndarray
        Shape (cells,), float64, uniformly distributed in [0, 1).
    """
    rows, columns = (np.arange(span.start, span.stop, dtype=np.uint64) for span in blocks.frame)
    place = (rows[:, None] << np.uint64(32)) + columns
    drawn = splitmix64(place ^ splitmix64(np.full(1, seed, np.uint64)))
    found: np.ndarray = (drawn >> np.uint64(11)).astype(float) * 2.0**-53
    return found.ravel()


def values_of_audit_attributes(counts: Sequence[Sequence[int]]) -> dict[str, int | float]:
    """Return the values of AUDIT_ATTRIBUTES by name, for a survey without a bound.

    counts: for each slice, the numbers of filled, audited and wrong cells.

    All slices of such a survey audit the same positions of the grid, so the audits of two slices are not independent.
    The upper bound for the survey is therefore the largest of the upper bounds for its slices; it is 0 if no cells are
    filled.

    Returns
    -------
    dict[str, int | float]
        Value of each attribute, by the attribute's name.
    """
    upper = max(share_upper_bound(disagreed, audited) if filled else 0.0 for filled, audited, disagreed in counts)
    return dict(zip(AUDIT_ATTRIBUTES, (*map(sum, zip(*counts, strict=True)), upper), strict=True))


def share_upper_bound(wrong: int, drawn: int, confidence: float = CONFIDENCE) -> float:
    """Return an upper bound, with this confidence, of the share of wrong cells, from a random sample of the cells.

    drawn: how many cells were drawn at random. wrong: how many of the drawn cells are wrong. The bound is the upper
    end of the one-sided interval of Clopper and Pearson, Biometrika 26 (1934) 404.

    Returns
    -------
    float
        From 0 to 1; 1 if no cell was drawn.
    """
    from scipy.special import betaincinv  # imported here, because it takes a tenth of a second to load

    return float(betaincinv(wrong + 1, drawn - wrong, confidence)) if wrong < drawn else 1.0
