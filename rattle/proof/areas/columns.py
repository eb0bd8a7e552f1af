"""Prove claims on a plane, column by column in δ: doubles guess where a claim holds, ball arithmetic proves it.

Within a column a claim holds for ε between two boundaries, which depend on δ. The finder takes the ε range that is
between the boundaries at every δ of the column, leaves a margin at both ends, and tries to prove the claim on the whole
range; where this fails, on the halves of the range.
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
from rattle.orbits.orbits_a_to_d import NAMES, classify_regions
from rattle.proof.areas.block import ABSENT, ATTRACTING, CAPTURED, LOUD, QUIET, REGIONS, SADDLE, ProvedBlock
from rattle.proof.areas.capture import require_captures_below_speed
from rattle.proof.areas.finder import BlockProver
from rattle.proof.areas.piece import PlanePiece, hull
from rattle.proof.balls import ball, precision
from rattle.proof.certificate import Ends

#: Precision of the balls in bits.
BITS = 64
#: For each kind of claim the number of narrower columns into which a column is cut. Claims about C take little time, so
#: their columns can be narrow.
COLUMN_DIVISIONS = {"region": 1, QUIET: 1, "D": 1, "C": 4}
#: Margins in ε between the boundaries of a claim and the proved range. The smallest margin with which a proof succeeds
#: is used.
MARGINS = tuple(Fraction(k, 10**6) for k in (40, 160, 640, 2560))
#: Upper ends in ε of the blocks with the claim "quiet captures", as shares of the quiet limit.
CAPTURE_SHARES = (0.3, 0.5, 0.65, 0.76, 0.84, 0.89, 0.925, 0.95, 0.965, 0.975, 0.98)
#: The measured capture speed of docs/decisions/0003 is multiplied by SPEED_FACTOR, at most MOST_SPEED_CUTS times, until
#: "quiet captures" is proved for the product.
SPEED_FACTOR, MOST_SPEED_CUTS = Fraction(3, 4), 12
#: A block states this share of its proved speed, so that programs with other rounding can confirm the block.
PUBLISHED_SHARE = Fraction(85, 100)
#: Claims are computed in doubles at GRID_POINTS equally spaced ε. The interval between two neighbouring ε is bisected
#: BISECTIONS times if their claims differ.
GRID_POINTS, BISECTIONS = 301, 24
#: Claims are also computed at this relative distance in ε on both sides of bifurcation curves.
CURVE_DISTANCE = 1e-6
#: Decimals of the ends of a block in ε.
PLACES = 6
#: Most times that the ε range of a claim is halved.
EPSILON_HALVINGS = 2

Span = tuple[str, float, float]  # (claim, low, high): the claim holds for low < ε < high


def cut_into_columns(delta: Ends, number: int) -> list[Ends]:
    """Cut an interval of δ into `number` columns of equal width."""
    low, high = delta
    places = [low + (high - low) * i / number for i in range(number + 1)]
    return list(pairwise(places))


def prove_column(beta: Fraction, delta: Ends, epsilon: Ends) -> list[ProvedBlock]:
    """Return all blocks that are proved in the column `delta` of a plane whose ends in ε are `epsilon`."""
    prover, found = BlockProver(beta), []
    with precision(BITS):
        for kind, parts in COLUMN_DIVISIONS.items():
            for part in cut_into_columns(delta, parts):
                for claim, low, high in expected_claim_spans(kind, float(beta), part, epsilon):
                    limits = _round_inwards(low, high, epsilon)
                    found += [
                        ProvedBlock(claim, beta, part, ends) for ends in _prove_ranges(prover, claim, part, limits)
                    ]
        found += _prove_captures(beta, delta, epsilon)
    return found


def _prove_captures(beta: Fraction, delta: Ends, epsilon: Ends) -> Iterator[ProvedBlock]:
    """Yield the proved blocks with the claim "quiet captures" in a column, from the least ε upwards.

    Yields
    ------
    ProvedBlock
        A block, with a speed below which all motions that leave Σ⁺ are proved to become quiet.
    """
    low, limit = epsilon[0], float(quiet_limit(float(delta[0])))
    for share in CAPTURE_SHARES:
        high = min(epsilon[1], round(Fraction(share * limit), PLACES))
        if not low < high:
            continue
        piece = PlanePiece(hull(*map(ball, delta)), hull(ball(low), ball(high)), ball(beta))
        speed = Fraction(capture_speed(float(delta[0]), float(high), float(beta)))
        for _ in range(MOST_SPEED_CUTS):
            speed = round(speed * SPEED_FACTOR, PLACES)
            try:
                require_captures_below_speed(piece, speed)
            except NotProvedError:
                continue
            yield ProvedBlock(CAPTURED, beta, delta, (low, high), round(speed * PUBLISHED_SHARE, PLACES))
            break
        low = high


def _round_inwards(low: float, high: float, plane: Ends) -> Ends:
    """Round the ε range from low to high inwards to PLACES decimals.

    plane: both ends of the plane in ε.

    Returns
    -------
    Ends
        The rounded ends. Where the range reaches an end of the plane or goes beyond it, the exact end of the plane.
    """
    unit = Fraction(1, 10**PLACES)
    least = plane[0] if low <= float(plane[0]) else (floor(Fraction(low) / unit) + 1) * unit
    return least, plane[1] if high >= float(plane[1]) else floor(Fraction(high) / unit) * unit


def _prove_ranges(prover: BlockProver, claim: str, delta: Ends, limits: Ends, depth: int = 0) -> list[Ends]:
    """Return the ε ranges within `limits` on which a claim is proved for all δ of a column; there may be none.

    depth: how often the ε range of the claim has been halved already.

    Returns
    -------
    list[Ends]
        The ranges in rising order.
    """

    def is_proved(low: Fraction, high: Fraction) -> bool:
        """Return whether the claim is proved for low ≤ ε ≤ high and all δ of the column."""
        try:
            prover.require_claim(claim, delta, (low, high))
        except NotProvedError:
            return False
        return True

    low, high = limits
    if not low < high:
        return []
    starts = [low, *(low + margin for margin in MARGINS)]
    stops = [high, *(high - margin for margin in MARGINS)]
    begin = next((a for a, b in pairwise(starts) if b < high and is_proved(a, b)), starts[-1])
    end = next((a for a, b in pairwise(stops) if low < b and is_proved(b, a)), stops[-1])
    if not begin < end:
        return []
    if is_proved(begin, end):
        return [(begin, end)]
    if depth == EPSILON_HALVINGS:
        return []
    middle = floor((begin + end) / 2 * 10**PLACES) * Fraction(1, 10**PLACES)
    halves = ((begin, middle), (middle, end))
    return [ends for half in halves for ends in _prove_ranges(prover, claim, delta, half, depth + 1)]


def expected_claim_spans(kind: str, beta: float, delta: Ends, epsilon: Ends) -> list[Span]:
    """Return the spans (intervals) of ε on which each claim of a kind holds, as computed in doubles.

    kind: "region", "C", "D" or QUIET. In a span the claim holds at both ends and in the middle of the δ interval.

    Returns
    -------
    list[Span]
        (claim, low, high) of each span.
    """
    places = [float(delta[0]), float(sum(delta)) / 2, float(delta[1])]
    found = [_claim_spans_at(kind, place, beta, epsilon) for place in places]
    spans = found[0]
    for others in found[1:]:
        both = [
            (claim, max(low, begin), min(high, end))
            for claim, low, high in spans for other, begin, end in others if other == claim
        ]  # fmt: skip
        spans = [span for span in both if span[1] < span[2]]
    return spans


def _claim_spans_at(kind: str, delta: float, beta: float, epsilon: Ends) -> list[Span]:
    """Return the spans (intervals) of ε on which each claim of a kind holds at one δ, as computed in doubles.

    kind: "region", "C", "D" or QUIET.

    Returns
    -------
    list[Span]
        (claim, low, high) of each span.
    """
    grid = _epsilon_grid(delta, beta, epsilon)
    here = _claims_at(kind, delta, grid, beta)
    changes = np.flatnonzero(here[1:] != here[:-1])
    low, high = grid[changes], grid[changes + 1]
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        same = _claims_at(kind, delta, middle, beta) == here[changes]
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    ends = [grid[0], *((low + high) / 2), grid[-1]]
    claims = here[[0, *(changes + 1)]]
    return [(str(claim), *each) for claim, each in zip(claims, pairwise(ends), strict=True) if claim]


def _epsilon_grid(delta: float, beta: float, epsilon: Ends) -> NDArray[np.float64]:
    """Return the ε at which claims are computed: equal steps, and points next to bifurcation curves, on both sides."""
    low, high = (float(end) for end in epsilon)
    # equal steps alone could miss a claim that holds only between two curves that are closer than a step
    known = [sn1_formula(delta), flip_formula(delta), *(grazing(curve, delta, beta).epsilon for curve in CURVES)]
    beside = np.ravel(np.multiply.outer(np.array(known, np.float64), [1 - CURVE_DISTANCE, 1 + CURVE_DISTANCE]))
    return np.unique([*np.linspace(low, high, GRID_POINTS), *beside[(beside > low) & (beside < high)]])


def _claims_at(kind: str, delta: float, epsilon: NDArray[np.float64], beta: float) -> NDArray[np.str_]:
    """Return the claim of a kind that holds at each ε (n,), as computed in doubles; "" where no claim holds.

    kind: "region", "C", "D" or QUIET.

    Returns
    -------
    NDArray[np.str_]
        The claims (n,).
    """
    if kind == QUIET:
        return np.where(epsilon < quiet_limit(delta), QUIET, LOUD)
    orbits = period_one(delta, epsilon, beta)
    if kind in NAMES:
        letter, i = kind, NAMES.index(kind)
        return np.where(
            orbits.exists[i], np.where(orbits.stable[i], ATTRACTING[letter], SADDLE[letter]), ABSENT[letter]
        )
    codes = classify_regions(orbits)
    return np.array(["", *REGIONS])[np.where(codes > len(REGIONS), 0, codes)]
