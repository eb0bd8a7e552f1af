"""Prove claims on blocks of the plane, column by column in δ. Doubles guess where a claim holds; balls prove it.

Within a column the claim that holds changes with ε at a few boundaries, and each boundary moves with δ. Between the
farthest positions of two boundaries, less a margin, the claim is first tried on the whole range, and if that fails on
its halves.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from itertools import pairwise
from math import floor

import numpy as np
from numpy.typing import NDArray

from rattle.errors import NotProvedError
from rattle.impacting.map.quiet import capture_speed
from rattle.impacting.orbits.limits import flip_formula, quiet_limit, sn1_formula
from rattle.impacting.orbits.period_one import CURVES, grazing, period_one
from rattle.orbits.period_one import NAMES, classify
from rattle.proof.areas.block import ABSENT, ATTRACTING, CAPTURED, LOUD, QUIET, REGIONS, SADDLE, ProvedBlock
from rattle.proof.areas.capture import require_captures
from rattle.proof.areas.finder import Prover
from rattle.proof.areas.piece import PlanePiece, hull
from rattle.proof.balls import ball, precision
from rattle.proof.certificate import Ends

BITS = 64
#: Number of narrower columns into which a column is cut, by kind of claim. Claims on C take little time.
CUT = {"region": 1, QUIET: 1, "D": 1, "C": 4}
MARGINS = tuple(Fraction(k, 10**6) for k in (40, 160, 640, 2560))  # distances in ε from a guessed boundary
# upper ends of blocks, as shares of the quiet limit
CAPTURED_TO = (0.3, 0.5, 0.65, 0.76, 0.84, 0.89, 0.925, 0.95, 0.965, 0.975, 0.98)
SLOWED, MOST_SLOWED = Fraction(3, 4), 12  # factor between tried speeds, and their number; docs/decisions/0003 starts
ROOM = Fraction(85, 100)  # published share of the proved speed, so that programs with other rounding confirm it
SEEN, HALVED = 301, 24  # points along ε at which doubles evaluate claims; bisections between two unlike points
BESIDE = 1e-6  # relative distance in ε of the points on either side of a curve
PLACES = 6  # decimals of the ends of blocks in ε
DEEPEST = 2  # most halvings of a claim's range of ε

Span = tuple[str, float, float]  # a claim, and the least and largest ε between which it holds


def columns(delta: Ends, number: int) -> list[Ends]:
    """Divide the interval delta into `number` columns of equal width."""
    low, high = delta
    places = [low + (high - low) * i / number for i in range(number + 1)]
    return list(pairwise(places))


def proved(beta: Fraction, delta: Ends, epsilon: Ends) -> list[ProvedBlock]:
    """Return the blocks on which claims are proved within one column."""
    prover, found = Prover(beta), []
    with precision(BITS):
        for kind, parts in CUT.items():
            for part in columns(delta, parts):
                for claim, low, high in expected(kind, float(beta), part, epsilon):
                    limits = _within(low, high, epsilon)
                    found += [ProvedBlock(claim, beta, part, ends) for ends in _proved(prover, claim, part, limits)]
        found += _captured(beta, delta, epsilon)
    return found


def _captured(beta: Fraction, delta: Ends, epsilon: Ends) -> Iterator[ProvedBlock]:
    """Yield blocks that end at fixed shares of the quiet limit, each with a speed below which quiet captures."""
    low, limit = epsilon[0], float(quiet_limit(float(delta[0])))
    for share in CAPTURED_TO:
        high = min(epsilon[1], round(Fraction(share * limit), PLACES))
        if not low < high:
            continue
        piece = PlanePiece(hull(*map(ball, delta)), hull(ball(low), ball(high)), ball(beta))
        speed = Fraction(capture_speed(float(delta[0]), float(high), float(beta)))
        for _ in range(MOST_SLOWED):
            speed = round(speed * SLOWED, PLACES)
            try:
                require_captures(piece, speed)
            except NotProvedError:
                continue
            yield ProvedBlock(CAPTURED, beta, delta, (low, high), round(speed * ROOM, PLACES))
            break
        low = high


def _within(low: float, high: float, plane: Ends) -> Ends:
    """Round a range of ε inwards to PLACES decimals, but keep the edges of the plane exactly."""
    unit = Fraction(1, 10**PLACES)
    least = plane[0] if low <= float(plane[0]) else (floor(Fraction(low) / unit) + 1) * unit
    return least, plane[1] if high >= float(plane[1]) else floor(Fraction(high) / unit) * unit


def _proved(prover: Prover, claim: str, delta: Ends, limits: Ends, depth: int = 0) -> list[Ends]:
    """Return the ranges of ε of the blocks on which the claim is proved."""

    def proves(low: Fraction, high: Fraction) -> bool:
        try:
            prover.require(claim, delta, (low, high))
        except NotProvedError:
            return False
        return True

    low, high = limits
    if not low < high:
        return []
    starts = [low, *(low + margin for margin in MARGINS)]
    stops = [high, *(high - margin for margin in MARGINS)]
    begin = next((a for a, b in pairwise(starts) if b < high and proves(a, b)), starts[-1])
    end = next((a for a, b in pairwise(stops) if low < b and proves(b, a)), stops[-1])
    if not begin < end:
        return []
    if proves(begin, end):
        return [(begin, end)]
    if depth == DEEPEST:
        return []
    middle = floor((begin + end) / 2 * 10**PLACES) * Fraction(1, 10**PLACES)
    halves = ((begin, middle), (middle, end))
    return [ends for half in halves for ends in _proved(prover, claim, delta, half, depth + 1)]


def expected(kind: str, beta: float, delta: Ends, epsilon: Ends) -> list[Span]:
    """Return the ranges of ε on which each claim of a kind should hold, evaluated in doubles.

    A claim must hold at both edges and in the middle of the column.

    Returns
    -------
    list[Span]
        (claim, low, high) of each range.
    """
    places = [float(delta[0]), float(sum(delta)) / 2, float(delta[1])]
    found = [_spans(kind, place, beta, epsilon) for place in places]
    spans = found[0]
    for others in found[1:]:
        both = [
            (claim, max(low, begin), min(high, end))
            for claim, low, high in spans for other, begin, end in others if other == claim
        ]  # fmt: skip
        spans = [span for span in both if span[1] < span[2]]
    return spans


def _spans(kind: str, delta: float, beta: float, epsilon: Ends) -> list[Span]:
    """Return the ranges of ε on which each claim of a kind holds at one δ, evaluated in doubles."""
    grid = _places(delta, beta, epsilon)
    here = _claims(kind, delta, grid, beta)
    changes = np.flatnonzero(here[1:] != here[:-1])
    low, high = grid[changes], grid[changes + 1]
    for _ in range(HALVED):
        middle = (low + high) / 2
        same = _claims(kind, delta, middle, beta) == here[changes]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    ends = [grid[0], *((low + high) / 2), grid[-1]]
    claims = here[[0, *(changes + 1)]]
    return [(str(claim), *each) for claim, each in zip(claims, pairwise(ends), strict=True) if claim]


def _places(delta: float, beta: float, epsilon: Ends) -> NDArray[np.float64]:
    """Return values of ε in equal steps, and on both sides of each curve where A and C begin, flip or graze."""
    low, high = (float(end) for end in epsilon)
    known = [sn1_formula(delta), flip_formula(delta), *(grazing(curve, delta, beta).epsilon for curve in CURVES)]
    beside = np.ravel(np.multiply.outer(np.array(known, np.float64), [1 - BESIDE, 1 + BESIDE]))
    return np.unique([*np.linspace(low, high, SEEN), *beside[(beside > low) & (beside < high)]])


def _claims(kind: str, delta: float, epsilon: NDArray[np.float64], beta: float) -> NDArray[np.str_]:
    """Return the claim of a kind that holds at each point, or "" where none holds."""
    if kind == QUIET:
        return np.where(epsilon < quiet_limit(delta), QUIET, LOUD)
    orbits = period_one(delta, epsilon, beta)
    if kind in NAMES:
        letter, i = kind, NAMES.index(kind)
        return np.where(
            orbits.exists[i], np.where(orbits.stable[i], ATTRACTING[letter], SADDLE[letter]), ABSENT[letter]
        )
    codes = classify(orbits)
    return np.array(["", *REGIONS])[np.where(codes > len(REGIONS), 0, codes)]
