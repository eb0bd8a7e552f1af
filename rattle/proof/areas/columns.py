"""A plane in columns: of each, the blocks on which claims are proved. Doubles guess where; balls prove it.

In a column of δ what holds changes with ε at few places, which move with δ. Between the farthest that they come, less a
margin, the claim is tried as a whole, and where that fails in halves.
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
from rattle.impacting.orbits.limits import quiet_limit
from rattle.impacting.orbits.period_one import period_one
from rattle.orbits.period_one import classify
from rattle.proof.areas.block import ATTRACTING, CAPTURED, LOUD, QUIET, REGIONS, SADDLE, Block
from rattle.proof.areas.capture import require_captures
from rattle.proof.areas.finder import Prover
from rattle.proof.areas.piece import Piece, hull
from rattle.proof.balls import ball, precision
from rattle.proof.certificate import Ends

BITS = 64
MARGINS = tuple(Fraction(k, 10**6) for k in (40, 160, 640, 2560))  # in ε, from where a claim ends
CAPTURED_TO = (0.3, 0.5, 0.65, 0.76, 0.84, 0.89, 0.925, 0.95, 0.965, 0.975, 0.98)  # of the quiet limit
SLOWED, MOST_SLOWED = Fraction(3, 4), 12  # speeds that are tried, from that of docs/decisions/0003
ROOM = Fraction(85, 100)  # of what was proved, so that others, who round otherwise, can confirm it
SEEN, HALVED = 301, 24  # points along ε at which claims are looked for, and how often the steps between are halved
PLACES = 6  # of corners in ε
DEEPEST = 2  # times that the ε of a claim are halved

Span = tuple[str, float, float]  # a claim and the ε between which it holds


def columns(delta: Ends, number: int) -> list[Ends]:
    """So many columns of equal width."""
    low, high = delta
    places = [low + (high - low) * i / number for i in range(number + 1)]
    return list(pairwise(places))


def proved(beta: Fraction, delta: Ends, epsilon: Ends) -> list[Block]:
    """The blocks that are proved of a column."""
    prover, found = Prover(beta), []
    with precision(BITS):
        for claim, low, high in expected(float(beta), delta, epsilon):
            limits = _within(low, high, epsilon)
            found += [Block(claim, beta, delta, ends) for ends in _proved(prover, claim, delta, limits)]
        found += _captured(beta, delta, epsilon)
    return found


def _captured(beta: Fraction, delta: Ends, epsilon: Ends) -> Iterator[Block]:
    """Blocks that end at some shares of the quiet limit, each with a speed below which quiet captures."""
    low, limit = epsilon[0], float(quiet_limit(float(delta[0])))
    for share in CAPTURED_TO:
        high = min(epsilon[1], round(Fraction(share * limit), PLACES))
        if not low < high:
            continue
        piece = Piece(hull(*map(ball, delta)), hull(ball(low), ball(high)), ball(beta))
        speed = Fraction(capture_speed(float(delta[0]), float(high), float(beta)))
        for _ in range(MOST_SLOWED):
            speed = round(speed * SLOWED, PLACES)
            try:
                require_captures(piece, speed)
            except NotProvedError:
                continue
            yield Block(CAPTURED, beta, delta, (low, high), round(speed * ROOM, PLACES))
            break
        low = high


def _within(low: float, high: float, plane: Ends) -> Ends:
    """The same in few digits, and the edges of the plane exactly."""
    unit = Fraction(1, 10**PLACES)
    least = plane[0] if low <= float(plane[0]) else (floor(Fraction(low) / unit) + 1) * unit
    return least, plane[1] if high >= float(plane[1]) else floor(Fraction(high) / unit) * unit


def _proved(prover: Prover, claim: str, delta: Ends, limits: Ends, depth: int = 0) -> list[Ends]:
    """The ε of the blocks on which the claim is proved."""

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


def expected(beta: float, delta: Ends, epsilon: Ends) -> list[Span]:
    """Where each claim holds at both edges and in the middle of a column, as doubles tell."""
    places = [float(delta[0]), float(sum(delta)) / 2, float(delta[1])]
    found = [_spans(place, beta, epsilon) for place in places]
    spans = found[0]
    for others in found[1:]:
        both = [
            (claim, max(low, begin), min(high, end))
            for claim, low, high in spans for other, begin, end in others if other == claim
        ]  # fmt: skip
        spans = [span for span in both if span[1] < span[2]]
    return spans


def _spans(delta: float, beta: float, epsilon: Ends) -> list[Span]:
    """Likewise, at one δ."""
    grid = np.linspace(float(epsilon[0]), float(epsilon[1]), SEEN)
    seen = _claims(delta, grid, beta)
    spans = []
    for here in seen:
        changes = np.flatnonzero(here[1:] != here[:-1])
        low, high = grid[changes], grid[changes + 1]
        kind = next(i for i, each in enumerate(seen) if each is here)
        for _ in range(HALVED):
            middle = (low + high) / 2
            same = _claims(delta, middle, beta)[kind] == here[changes]
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        ends = [grid[0], *((low + high) / 2), grid[-1]]
        claims = here[[0, *(changes + 1)]]
        spans += [(str(claim), *each) for claim, each in zip(claims, pairwise(ends), strict=True) if claim]
    return spans


def _claims(delta: float, epsilon: NDArray[np.float64], beta: float) -> list[NDArray[np.str_]]:
    """The claims of each kind that hold at these points, "" where none does."""
    orbits = period_one(delta, epsilon, beta)
    regions = np.array(["", *REGIONS])[np.where(classify(orbits) > len(REGIONS), 0, classify(orbits))]
    quiet = np.where(epsilon < quiet_limit(delta), QUIET, LOUD)
    stable = [
        np.where(orbits.exists[i], np.where(orbits.stable[i], ATTRACTING[letter], SADDLE[letter]), "")
        for i, letter in ((2, "C"), (3, "D"))
    ]
    return [regions, quiet, *stable]
