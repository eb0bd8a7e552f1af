"""Rounds of audits of a survey whose share of wrong cells must meet a bound.

Each round audits a random sample of the filled cells. It draws the sample from cells that no earlier round has drawn,
so the sample is independent of all earlier decisions. If the bound is not met, there is another round. That round first
computes all cells of the leaves (squares of cells) in which too many audited cells were wrong: the leaves without chaos
up to one size, and the leaves with chaos up to another size. Then it audits as many cells as the bound needs. The last
round computes all remaining cells.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.survey.refined.audit import CONFIDENCE, share_upper_bound

LAST_ROUND = 5  # number of the round that computes all remaining cells; the first round has the number 0
#: The kind of a leaf (a square of cells) is log2 of its size, plus CHAOTIC if its computed cells have chaotic or
#: undecided samples. There are KINDS kinds.
CHAOTIC, KINDS = 8, 16
#: A round computes all cells of some leaves. Starting with the kind of leaf that has the largest share of wrong cells,
#: kinds are added until the expected share of wrong cells in all other leaves is at most this multiple of the bound.
WRONG_TARGET = 0.5
MOST_AUDITED = 0.5  # a round that would have to audit more than this share of the filled cells computes all of them
#: The first audit draws this many times the number of cells that suffices in the best case, in which all cells are
#: filled and none is wrong.
FIRST_AUDIT_FACTOR = 3.0


class AuditRound(NamedTuple):
    """A round of audits.

    draw_limit: the round audits the filled cells whose random number (see `random_numbers_of_cells`) is below this
    value, but not below that of the round before. regular_leaf_size, chaotic_leaf_size: sizes of leaves (squares of
    cells). Before the audit the round computes all cells of two kinds of leaves: leaves without chaos up to the size
    `regular_leaf_size`, leaves with chaos up to `chaotic_leaf_size`.
    """

    draw_limit: float
    regular_leaf_size: int = 0
    chaotic_leaf_size: int = 0


class AuditCounts(NamedTuple):
    """The findings of a round of audits; each array (KINDS,) has a number for each kind of leaf.

    filled_before: how many cells were to be filled before the round. audited: how many of these cells the round
    audited.
    disagreed: how many audited cells were wrong. filled: how many cells are filled after the round.
    """

    filled_before: np.ndarray
    audited: np.ndarray
    disagreed: np.ndarray
    filled: np.ndarray


def confidence_of_round(number: int) -> float:
    """Return the confidence of the bound of round `number`; together all bounds hold with at least CONFIDENCE."""
    return 1.0 - (1.0 - CONFIDENCE) / 2.0 ** (number + 1)


def create_first_audit_round(audit: float, bound: float | None, cells: int) -> AuditRound:
    """Return the first round of audits of a survey.

    audit: the least share of the filled cells to audit. bound: the largest allowed share of wrong cells; None if the
    request has no bound. cells: the number of cells of the survey.

    Returns
    -------
    AuditRound
        A round that only audits; later rounds first compute all cells of some leaves.
    """
    if bound is None:
        return AuditRound(audit)
    needed = -FIRST_AUDIT_FACTOR * math.log(1.0 - confidence_of_round(0)) / (bound * cells)
    return AuditRound(1.0 if needed > MOST_AUDITED else max(audit, needed))


def upper_bound_of_wrong_share(counts: AuditCounts, number: int) -> float:
    """Return an upper bound of the share of wrong cells among the cells that are filled after a round.

    counts: the findings of the round. number: the number of the round. The audit bounds the number of wrong cells
    before the round. The wrong cells that the audit found are subtracted, because they are now computed.

    Returns
    -------
    float
        From 0 to 1; 0 if no cell is filled.
    """
    filled, wrong, audited = (int(x.sum()) for x in (counts.filled, counts.disagreed, counts.audited))
    if not filled:
        return 0.0
    left = share_upper_bound(wrong, audited, confidence_of_round(number)) * int(counts.filled_before.sum()) - wrong
    return min(max(left, 0.0) / filled, 1.0)


def next_audit_round(bound: float, rounds: tuple[AuditRound, ...], counts: AuditCounts) -> AuditRound | None:
    """Return the next round of audits, or None if the bound is met. counts: the findings of the round `rounds[-1]`."""
    number = len(rounds)
    if upper_bound_of_wrong_share(counts, number - 1) <= bound:
        return None
    limits = [rounds[-1].regular_leaf_size, rounds[-1].chaotic_leaf_size]
    left = counts.filled.astype(float)
    rate = counts.disagreed / np.maximum(counts.audited, 1)
    kind = np.arange(KINDS)
    while (left * rate).sum() > WRONG_TARGET * bound * left.sum():
        worst = int(np.where(left > 0.0, rate, -1.0).argmax())
        of, size = divmod(worst, CHAOTIC)
        limits[of] = max(limits[of], 1 << size)
        left[(kind // CHAOTIC == of) & (kind % CHAOTIC <= size)] = 0.0
    drawn = rounds[-1].draw_limit
    share = (
        1.0
        if number == LAST_ROUND
        else _share_to_audit(bound, left.sum(), (left * rate).sum(), confidence_of_round(number))
    )
    return AuditRound(drawn + share * (1.0 - drawn) if share < 1.0 else 1.0, *limits)


def _share_to_audit(bound: float, filled: float, wrong: float, confidence: float) -> float:
    """Return the share of the filled cells to audit so that the bound will be met, or 1 to compute all of them.

    filled: the number of filled cells. wrong: how many filled cells are expected to be wrong. confidence: the
    probability with which the bound must hold.

    Returns
    -------
    float
        A share of at most MOST_AUDITED, or 1.
    """
    share = 1.2 * -math.log(1.0 - confidence) / (bound * max(filled, 1.0))
    while share <= MOST_AUDITED:
        found = share * wrong
        likely = math.ceil(found + 2.0 * math.sqrt(found))
        audited = math.floor(share * filled)
        if audited and share_upper_bound(likely, audited, confidence) - likely / filled <= bound * (1.0 - share):
            return share
        share *= 1.5
    return 1.0
