"""Prove chaos at one point of the plane, from computed motions to a certificate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import islice, pairwise

import numpy as np

from rattle._version import __version__
from rattle.errors import NotProvedError, require
from rattle.impacting.gear import Gear
from rattle.proof.balls import VERSIONS, arb, ball, precision
from rattle.proof.certificate import Exact, exact_number
from rattle.proof.chaos import search
from rattle.proof.chaos.certificate import HorseshoeCertificate, Loop
from rattle.proof.chaos.coverings import HSet, Mapped, Pair, SetPart
from rattle.proof.flights import ModelPlane

PLACES_TRIED = 3
POINT = SetPart(0.0, 0.0, 0.0, 0.0)
DIGITS = Fraction(1, 10**4)  # unit to which the published entropy is rounded down


def certify_chaos(delta: Exact, epsilon: Exact, beta: Exact = "0.6") -> HorseshoeCertificate:
    """Prove that the impacting gear has chaotic motions: find a horseshoe and a lower bound of its entropy.

    The proof takes half a minute and needs the extra `proof`. Source: docs/proofs.md, lemmas 11 to 14.

    Parameters
    ----------
    delta, epsilon, beta : float, str or Fraction
        Damping, eccentricity and half-backlash of the point, taken exactly.

    Returns
    -------
    HorseshoeCertificate
        The sets, their covering relations, and the lower bounds of the entropy.

    Raises
    ------
    ParameterError
        If a parameter is not allowed.
    NotProvedError
        If no horseshoe is found or proved. The gear may be chaotic nevertheless.
    """
    parameters = {
        "delta": exact_number("delta", delta),
        "epsilon": exact_number("epsilon", epsilon),
        "beta": exact_number("beta", beta),
    }
    require(min(parameters.values()) > 0, "delta, epsilon and beta must be positive")
    gear = Gear(*(float(number) for number in parameters.values()))
    best: HorseshoeCertificate | None = None
    with precision():
        plane = ModelPlane(*(ball(number) for number in parameters.values()))
        for found in islice(search.search_horseshoes(gear), PLACES_TRIED):
            proved = _proved(plane, parameters, found)
            if proved is not None and (best is None or proved.per_impact > best.per_impact):
                best = proved
    if best is None:
        raise NotProvedError(
            "no two loops are proved to be stretched across each other; the gear may be chaotic nevertheless"
        )
    return best


def _proved(plane: ModelPlane, parameters: dict[str, Fraction], found: search.Found) -> HorseshoeCertificate | None:
    """Return the theorem about the loops of a hub that can be proved, or None if these are fewer than two."""
    hub = _exactly(found.hub)
    sets, loops = [hub], list[Loop]()
    sources: dict[tuple[int, int], Mapped] = {}  # all loops share the images of the hub
    for each in found.loops:
        new = [_exactly(box) for box in each.boxes]
        numbers = range(len(sets), len(sets) + len(new))
        try:
            require_apart([*new, hub][:1], [sets[loop.head] for loop in loops])
            periods = _covered(plane, [hub, *new, hub], each.words, sources)
        except NotProvedError:
            continue
        sets += new
        loops.append(Loop(tuple(numbers), each.words, periods))
    if len(loops) < 2:
        return None
    return HorseshoeCertificate(
        parameters=parameters,
        sets=tuple(sets),
        loops=tuple(loops),
        per_impact=entropy([loop.length for loop in loops]),
        per_period=entropy([sum(loop.periods) for loop in loops]),
        versions={"gear-rattle": __version__, **VERSIONS},
    )


def _covered(
    plane: ModelPlane, chain: Sequence[HSet], words: Sequence[int], sources: dict[tuple[int, int], Mapped]
) -> tuple[int, ...]:
    """Return the forcing periods after which each set of a chain covers the next; NotProvedError if one does not."""
    periods = []
    for i, ((source, target), word) in enumerate(zip(pairwise(chain), words, strict=True)):
        mapped = Mapped(plane, source, (-1,) * word)
        if i == 0:
            mapped = sources.setdefault((0, word), mapped)
        middle = mapped.image(POINT)
        if middle is None:
            raise NotProvedError("the middle of a set meets other walls")
        periods.append(round(float(middle.middle[0]) - float(target.centre[0])))
        mapped.require_covers(target, periods[-1])
    return tuple(periods)


def _exactly(box: search.StateBox) -> HSet:
    """Return a box whose numbers are rounded to few digits, with its time in [0, 1)."""
    t, v = (Fraction(f"{x:.15f}") for x in (float(box.centre[0]) % 1.0, float(box.centre[1])))
    unstable, stable = (tuple(Fraction(f"{x:.8e}") for x in column) for column in np.asarray(box.sides).T)
    return HSet((t, v), (unstable[0], unstable[1]), (stable[0], stable[1]))


def require_apart(some: Sequence[HSet], others: Sequence[HSet]) -> None:
    """Raise NotProvedError unless each set of `some` is disjoint, modulo whole periods, from each set of `others`."""
    for one in some:
        for other in others:
            for periods in (-1, 0, 1):
                if not apart(list(one.corners()), [(t + periods, v) for t, v in other.corners()]):
                    raise NotProvedError("the first sets of two loops are not proved disjoint")


def apart(one: Sequence[Pair], other: Sequence[Pair]) -> bool:
    """Return whether a line along a side of either of two parallelograms separates them.

    The corners must be in the order of `HSet.corners`.

    Returns
    -------
    bool
        False means that they may overlap.
    """
    for a in (one, other):
        for i in (1, 2):
            normal = a[i][1] - a[0][1], a[0][0] - a[i][0]
            first, second = ([normal[0] * t + normal[1] * v for t, v in corners] for corners in (one, other))
            if max(first) < min(second) or max(second) < min(first):
                return True
    return False


def entropy(lengths: Sequence[int]) -> Fraction:
    """Return a number h, rounded to few digits, for which Σ e^(−h length) ≥ 1 is proved."""
    h = Fraction(math.floor(search.growth(lengths) / DIGITS)) * DIGITS
    while h > 0:
        if sum(((-ball(h) * length).exp() for length in lengths), arb(0)) >= 1:
            return h
        h -= DIGITS
    return Fraction(0)
