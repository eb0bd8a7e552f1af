"""Rounds of audits of a survey whose share of wrong cells must meet a bound.

Each round audits a random sample of the filled cells, from cells that no earlier round has drawn, so the sample is
independent of all earlier decisions. If the bound is not met, there is a next round. It first computes whole the leaves
of those kinds in which too many cells were wrong; then it audits as many cells as the bound needs. The last round
computes all remaining cells.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gear_rattle.workers.survey.refined.audit import SURE, upper_share

LAST = 5  # number of the round that computes all remaining cells; the first round is 0
#: The kind of a leaf is log2 of its size, plus CHAOTIC if chaos was seen on its edges; there are KINDS kinds.
CHAOTIC, KINDS = 8, 16
#: Leaves are computed whole until the expected share of wrong cells is at most this share of the bound.
AIM = 0.5
MOST = 0.5  # if a round had to audit a larger share of the filled cells than this, it computes all of them
#: The first audit has this many times the cells that would suffice if all cells were filled and none were wrong.
SPARE = 3.0


class Round(NamedTuple):
    """A round of audits.

    drawn: filled cells whose draw is below this are audited. regular, chaotic: before that, leaves of at most this size
    are computed whole; `regular` is the limit for leaves without chaos, `chaotic` for leaves with chaos.
    """

    drawn: float
    regular: int = 0
    chaotic: int = 0


class Counts(NamedTuple):
    """Findings of a round, by kind of leaf (KINDS,).

    before: how many cells were to be filled before the round. audited: how many of these it audited. disagreed: how
    many audited cells were wrong. filled: how many cells are filled after the round.
    """

    before: np.ndarray
    audited: np.ndarray
    disagreed: np.ndarray
    filled: np.ndarray


def sure_of(number: int) -> float:
    """Return the confidence of a round's bound, such that all rounds together have the confidence SURE."""
    return 1.0 - (1.0 - SURE) / 2.0 ** (number + 1)


def first_round(audit: float, bound: float | None, cells: int) -> Round:
    """Return the first round for a survey. audit: the least share of cells to audit. cells: the survey's cells."""
    if bound is None:
        return Round(audit)
    needed = -SPARE * math.log(1.0 - sure_of(0)) / (bound * cells)
    return Round(1.0 if needed > MOST else max(audit, needed))


def upper_of(counts: Counts, number: int) -> float:
    """Return an upper bound of the share of wrong cells among the cells that are filled after a round.

    The audit bounds the number of wrong cells before the round; the wrong cells that it found are subtracted, because
    they have been computed.

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
    """Return the next round of audits, or None if the bound is met. counts: the findings of the last of `rounds`."""
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
    """Return the share of `filled` cells to audit if `wrong` of them are expected to be wrong; 1: compute them all."""
    share = 1.2 * -math.log(1.0 - sure) / (bound * max(filled, 1.0))
    while share <= MOST:
        found = share * wrong
        likely = math.ceil(found + 2.0 * math.sqrt(found))
        audited = math.floor(share * filled)
        if audited and upper_share(likely, audited, sure) - likely / filled <= bound * (1.0 - share):
            return share
        share *= 1.5
    return 1.0
