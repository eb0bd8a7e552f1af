"""Prove chaos at one point of the plane: find a horseshoe in doubles, and prove that each set covers the next."""

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
from rattle.proof.chaos.certificate import HorseshoeCertificate, HorseshoeLoop
from rattle.proof.chaos.coverings import HSet, MappedSet, Pair, SetPart
from rattle.proof.flights import ModelPoint

#: Number of found horseshoes that are tried; the one with the largest entropy is kept.
CANDIDATES_TRIED = 3
#: The part of a set that consists of the middle of the set only.
MIDDLE_PART = SetPart(0.0, 0.0, 0.0, 0.0)
#: Unit to which the published entropy is rounded down.
ENTROPY_UNIT = Fraction(1, 10**4)


def certify_chaos(delta: Exact, epsilon: Exact, beta: Exact = "0.6") -> HorseshoeCertificate:
    """Prove that the impacting gear has chaotic motions at one point, by a horseshoe of its impact map.

    The proof takes half a minute and needs the extra `proof`. The method is in docs/proofs.md.

    Parameters
    ----------
    delta, epsilon, beta : Exact
        The exact parameters: numbers, text such as "0.6" or "3/5", or Fractions.

    Returns
    -------
    HorseshoeCertificate
        Sets and coverings, and lower bounds of the topological entropy.

    Raises
    ------
    ParameterError
        If a parameter is not positive.
    NotProvedError
        If no horseshoe is found or proved; there may be one all the same.
    """
    parameters = {
        "delta": exact_number("delta", delta),
        "epsilon": exact_number("epsilon", epsilon),
        "beta": exact_number("beta", beta),
    }
    wrong = [name for name, number in parameters.items() if number <= 0]
    require(not wrong, f"{' and '.join(wrong)} must be positive")
    gear = Gear(*(float(number) for number in parameters.values()))
    best: HorseshoeCertificate | None = None
    with precision():
        point = ModelPoint(*(ball(number) for number in parameters.values()))
        for found in islice(search.search_horseshoes(gear), CANDIDATES_TRIED):
            proved = _prove_loops(point, parameters, found)
            if proved is not None and (best is None or proved.per_impact > best.per_impact):
                best = proved
    if best is None:
        raise NotProvedError(
            "no horseshoe of two or more loops is proved at this point: try a point nearby; motions may be chaotic all "
            "the same"
        )
    return best


def _prove_loops(
    point: ModelPoint, parameters: dict[str, Fraction], candidate: search.HorseshoeCandidate
) -> HorseshoeCertificate | None:
    """Return the certificate of those loops of a candidate that are proved, or None if fewer than two are proved."""
    hub = _round_to_exact_set(candidate.hub)
    sets, loops = [hub], list[HorseshoeLoop]()
    sources: dict[tuple[int, int], MappedSet] = {}  # all loops share the images of the parts of set 0
    for each in candidate.loops:
        new = [_round_to_exact_set(box) for box in each.boxes]
        numbers = range(len(sets), len(sets) + len(new))
        try:
            require_disjoint_sets([*new, hub][:1], [sets[loop.first_set_number] for loop in loops])
            periods = _prove_chain(point, [hub, *new, hub], each.words, sources)
        except NotProvedError:
            continue
        sets += new
        loops.append(HorseshoeLoop(tuple(numbers), each.words, periods))
    if len(loops) < 2:
        return None
    return HorseshoeCertificate(
        parameters=parameters,
        sets=tuple(sets),
        loops=tuple(loops),
        per_impact=entropy_lower_bound([loop.length for loop in loops]),
        per_period=entropy_lower_bound([sum(loop.periods) for loop in loops]),
        versions={"gear-rattle": __version__, **VERSIONS},
    )


def _prove_chain(
    point: ModelPoint, chain: Sequence[HSet], words: Sequence[int], sources: dict[tuple[int, int], MappedSet]
) -> tuple[int, ...]:
    """Prove that each set of a chain covers the next, at the given parameter point.

    words: for each step the number of impacts on Σ⁻. sources: {(0, word): the first set of the chain, with its images};
    this function adds the entry of the first step if it is missing.

    Returns
    -------
    tuple[int, ...]
        The number of forcing periods of each step.

    Raises
    ------
    NotProvedError
        If a covering is not proved.
    """
    periods = []
    for i, ((source, target), word) in enumerate(zip(pairwise(chain), words, strict=True)):
        mapped = MappedSet(point, source, (-1,) * word)
        if i == 0:
            mapped = sources.setdefault((0, word), mapped)
        middle = mapped.image(MIDDLE_PART)
        if middle is None:
            raise NotProvedError(
                f"the motion from the centre of parallelogram {i} of a loop is not proved to make {word} impacts on Σ⁻ "
                "before it meets Σ⁺"
            )
        periods.append(round(float(middle.middle[0]) - float(target.centre[0])))
        mapped.require_covering(target, periods[-1])
    return tuple(periods)


def _round_to_exact_set(box: search.StateParallelogram) -> HSet:
    """Return a set close to a computed box, with exact numbers of few digits, and with its time shifted to [0, 1)."""
    t, v = (Fraction(f"{x:.15f}") for x in (float(box.centre[0]) % 1.0, float(box.centre[1])))
    unstable, stable = (tuple(Fraction(f"{x:.8e}") for x in column) for column in np.asarray(box.sides).T)
    return HSet((t, v), (unstable[0], unstable[1]), (stable[0], stable[1]))


def require_disjoint_sets(first: Sequence[HSet], second: Sequence[HSet]) -> None:
    """Raise NotProvedError unless no set of `first` meets a set of `second`, with times taken modulo 1."""
    for one in first:
        for other in second:
            for periods in (-1, 0, 1):
                if not are_parallelograms_separated(
                    list(one.corners()), [(t + periods, v) for t, v in other.corners()]
                ):
                    raise NotProvedError(
                        "the first parallelograms of two loops may overlap, so the loops are not proved to differ"
                    )


def are_parallelograms_separated(one: Sequence[Pair], other: Sequence[Pair]) -> bool:
    """Return whether a line along a side of one of two parallelograms separates them.

    one, other: the corners of the parallelograms, in the order of `HSet.corners`.

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


def entropy_lower_bound(lengths: Sequence[int]) -> Fraction:
    """Return a lower bound h ≥ 0 of a horseshoe's topological entropy: Σ e^(−h length) ≥ 1, summed over its loops.

    lengths: for each loop its number of impacts on Σ⁺, or for each loop its number of forcing periods.

    Returns
    -------
    Fraction
        h, in nats per impact on Σ⁺, or per forcing period (Lemma 13 of docs/proofs.md).
    """
    h = Fraction(math.floor(search.entropy_of_loop_lengths(lengths) / ENTROPY_UNIT)) * ENTROPY_UNIT
    while h > 0:
        if sum(((-ball(h) * length).exp() for length in lengths), arb(0)) >= 1:
            return h
        h -= ENTROPY_UNIT
    return Fraction(0)
