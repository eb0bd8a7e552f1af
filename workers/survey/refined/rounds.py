"""Rounds of audits: the next round for a survey whose wrong share must meet a bound.

Each round draws cells that no earlier round has drawn, from the cells that are filled then: a sample independent of all
earlier decisions. Cells that a round finds wrong are computed. Kinds of leaves in which too many cells were wrong are
computed whole in the next round, which audits as many cells as the bound needs; the last round computes all that are
left.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.survey.refined.audit import SURE, upper_share

LAST = 5  # number of the round that computes all remaining cells; the first round is 0
CHAOTIC, KINDS = 8, 16  # a kind of leaf: the logarithm of its size, and CHAOTIC where chaos was seen on its edges
#: Expected wrong share after leaves are computed whole, as a share of the bound.
AIM = 0.5
MOST = 0.5  # largest share to audit; instead of a larger one all cells are computed
SPARE = 3.0  # factor of the first audit, over the size that suffices if all cells are filled and none is wrong


class Round(NamedTuple):
    """A round of audits.

    drawn: filled cells whose draw is below this are audited. regular, chaotic: leaves of at most so many cells a side,
    without and with chaos, are computed whole before that.
    """

    drawn: float
    regular: int = 0
    chaotic: int = 0


class Counts(NamedTuple):
    """Findings of a round, by kind of leaf (KINDS,).

    before: cells to be filled before the round. audited, disagreed: audited cells, and those that disagreed. filled:
    filled cells after the round.
    """

    before: np.ndarray
    audited: np.ndarray
    disagreed: np.ndarray
    filled: np.ndarray


def sure_of(number: int) -> float:
    """Return the confidence of a round's bound; all rounds together have SURE, however many there are."""
    return 1.0 - (1.0 - SURE) / 2.0 ** (number + 1)


def first_round(audit: float, bound: float | None, cells: int) -> Round:
    """Return the first round for a survey of so many cells; audit: the least share of audited cells."""
    if bound is None:
        return Round(audit)
    needed = -SPARE * math.log(1.0 - sure_of(0)) / (bound * cells)
    return Round(1.0 if needed > MOST else max(audit, needed))


def upper_of(counts: Counts, number: int) -> float:
    """Return the upper bound of the share of wrong cells among those that are filled after a round.

    It is the audit's bound for the cells before the round, less the wrong cells that were found.

    Returns
    -------
    float
        From 0 to 1.
    """
    filled, wrong, audited = (int(x.sum()) for x in (counts.filled, counts.disagreed, counts.audited))
    if not filled:
        return 0.0
    left = upper_share(wrong, audited, sure_of(number)) * int(counts.before.sum()) - wrong
    return min(max(left, 0.0) / filled, 1.0)


def next_round(bound: float, rounds: tuple[Round, ...], counts: Counts) -> Round | None:
    """Return the round after these, given the findings of the last one; None if the bound is met."""
    number = len(rounds)
    if upper_of(counts, number - 1) <= bound:
        return None
    limits = [rounds[-1].regular, rounds[-1].chaotic]
    left = counts.filled.astype(float)
    rate = counts.disagreed / np.maximum(counts.audited, 1)
    kind = np.arange(KINDS)
    while (left * rate).sum() > AIM * bound * left.sum():
        worst = int(np.where(left > 0.0, rate, -1.0).argmax())
        of, size = divmod(worst, CHAOTIC)
        limits[of] = max(limits[of], 1 << size)
        left[(kind // CHAOTIC == of) & (kind % CHAOTIC <= size)] = 0.0
    drawn = rounds[-1].drawn
    share = 1.0 if number == LAST else _share(bound, left.sum(), (left * rate).sum(), sure_of(number))
    return Round(drawn + share * (1.0 - drawn) if share < 1.0 else 1.0, *limits)


def _share(bound: float, filled: float, wrong: float, sure: float) -> float:
    """Return the share of filled cells to audit if so many are expected to be wrong; 1 if all must be computed."""
    share = 1.2 * -math.log(1.0 - sure) / (bound * max(filled, 1.0))
    while share <= MOST:
        found = share * wrong
        likely = math.ceil(found + 2.0 * math.sqrt(found))
        audited = math.floor(share * filled)
        if audited and upper_share(likely, audited, sure) - likely / filled <= bound * (1.0 - share):
            return share
        share *= 1.5
    return 1.0
