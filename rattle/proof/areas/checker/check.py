"""Check the claims about blocks of the plane: run `python -m checker.check FILE` in the folder that contains `checker`.

Each claim is proved again by other means than the finder's: other interval arithmetic, other unknowns and other
derivatives. The lemmas and the numbers of equations are those of docs/proofs.md.
"""

import json
import sys
from fractions import Fraction
from functools import lru_cache
from typing import Any

from .column import TwoImpactColumn
from .intervals import IV, BlockRefusal, Interval, interval_between, number_from_text, require
from .one_impact import OneImpactBlock
from .quiet_motion import BounceBounds, require_side_of_quiet_limit

#: Most times that the δ interval of a block is halved before the block is refused.
DELTA_HALVINGS = 5
#: Most times that a block with the claim "quiet captures" is halved, in ε and δ in turn.
CAPTURE_HALVINGS = 2
NONE, THERE, ATTRACTING, SADDLE = "none", "there", "attracting", "a saddle"
#: {region: the state of each motion A to D at all points of a block that is claimed to be in this region}.
REGIONS = {
    "I": {"A": NONE, "B": NONE, "C": NONE, "D": NONE},
    "II": {"A": SADDLE, "B": NONE, "C": THERE, "D": NONE},
    "III": {"A": SADDLE, "B": SADDLE, "C": THERE, "D": ATTRACTING},
    "IV": {"A": SADDLE, "B": SADDLE, "C": THERE, "D": SADDLE},
    "V": {"A": SADDLE, "B": NONE, "C": NONE, "D": THERE},
}
#: {claim: {letter: state of the motion with this letter, by the claim}}. A claim says nothing about other motions.
CLAIMS = REGIONS | {
    f"{letter} {words}": {letter: state}
    for letter in "CD" for words, state in (("attracts", ATTRACTING), ("is a saddle", SADDLE), ("is not there", NONE))
}  # fmt: skip
QUIET, CAPTURES = {"quiet is possible": True, "quiet is impossible": False}, "quiet captures"
Ends = tuple[Fraction, Fraction]
column = lru_cache(maxsize=64)(TwoImpactColumn)  # claims about the same δ and β share a `TwoImpactColumn` and its cells


def prove_claim(claim: str, beta: Fraction, delta: Ends, epsilon: Ends, depth: int = 0) -> None:
    """Raise BlockRefusal unless a claim is proved on a block, which may be halved in δ up to DELTA_HALVINGS times.

    depth: how often the block has been halved already.

    Raises
    ------
    BlockRefusal
        If the claim is not proved.
    """
    try:
        prove_on_whole_block(claim, beta, delta, epsilon)
    except BlockRefusal:
        if depth == DELTA_HALVINGS:
            raise
        half = (delta[0] + delta[1]) / 2
        for part in ((delta[0], half), (half, delta[1])):
            prove_claim(claim, beta, part, epsilon, depth + 1)


def prove_on_whole_block(claim: str, beta: Fraction, delta: Ends, epsilon: Ends) -> None:
    """Raise BlockRefusal unless a claim is proved on a block as a whole, without cutting it."""
    d, e = interval_between(*delta), interval_between(*epsilon)
    if claim in QUIET:
        return require_side_of_quiet_limit(d, e, QUIET[claim])
    squares = IV.mpf((e**2).a), IV.mpf((e**2).b)
    for letter, state in CLAIMS[claim].items():
        if letter in "AC":
            found = prove_state_of_a_or_c(letter, state, d, interval_between(beta, beta), squares)
        else:
            found = prove_state_of_b_or_d(1 if letter == "D" else -1, state, column(delta, beta), squares)
        require(found == state, f"the state of {letter} is proved to be {found!r}, but {state!r} is claimed")
    return None


def prove_captures(beta: Fraction, delta: Ends, epsilon: Ends, speed: Interval, depth: int = 0) -> None:
    """Raise BlockRefusal unless all motions that leave Σ⁺ slower than `speed` are proved to become quiet on a block.

    depth: how often the block has been halved already.

    Raises
    ------
    BlockRefusal
        If the claim is not proved.
    """
    try:
        BounceBounds(
            interval_between(*delta), interval_between(*epsilon), interval_between(beta, beta)
        ).require_captures_below(speed)
    except BlockRefusal:
        if depth == CAPTURE_HALVINGS:
            raise
        cut = epsilon if depth % 2 == 0 else delta
        half = (cut[0] + cut[1]) / 2
        for part in ((cut[0], half), (half, cut[1])):
            both = (delta, part) if depth % 2 == 0 else (part, epsilon)
            prove_captures(beta, *both, speed, depth + 1)


def prove_state_of_a_or_c(
    letter: str, state: str, d: Interval, beta: Interval, squares: tuple[Interval, Interval]
) -> str:
    """Return the existence and stability of A or C that are proved for all points of a block.

    The stability is proved only if the claimed `state` is ATTRACTING or SADDLE. squares: the least and the largest ε²
    of the block.

    Returns
    -------
    str
        NONE, THERE, ATTRACTING or SADDLE.

    Raises
    ------
    BlockRefusal
        If the existence, or a stability that is to be proved, is not proved to be the same on the whole block.
    """
    motion = OneImpactBlock(letter, d, beta, *squares)
    if not motion.exists():
        return NONE
    return THERE if state in (THERE, NONE) else ATTRACTING if motion.attracts() else SADDLE


def prove_state_of_b_or_d(slope: int, state: str, cells: TwoImpactColumn, squares: tuple[Interval, Interval]) -> str:
    """Return the existence and stability of B (slope −1) or D (slope 1) that are proved for all points of a block.

    The stability is proved only if the claimed `state` is ATTRACTING or SADDLE. squares: the least and the largest ε²
    of the block.

    Returns
    -------
    str
        NONE, THERE, ATTRACTING or SADDLE.

    Raises
    ------
    BlockRefusal
        If the existence, or a stability that is to be proved, is not proved to be the same on the whole block; or if
        there are several motions.
    """
    runs = cells.enclose_motions_in_runs(slope, *squares)
    require(len(runs) < 2, f"there are {len(runs)} motions {'D' if slope > 0 else 'B'}, where at most one is claimed")
    if not runs:
        return NONE
    return THERE if state in (THERE, NONE) else ATTRACTING if cells.attracts(runs[0], *squares) else SADDLE


def check(text: str) -> str:
    """Prove the claim that a JSON document makes about a block, and return the claim in words. Raises BlockRefusal."""
    try:
        document = json.loads(text)
        require((document["format"], document["theorem"]) == (1, "area"), "`format` and `theorem` must be 1 and 'area'")
        claim, beta = document["claim"], number_from_text(document["beta"])
        delta, epsilon = (ends_from_texts(document[name]) for name in ("delta", "epsilon"))
        require(beta > 0 and delta[0] > 0, "`beta` and `delta` must be positive")
        if claim == CAPTURES:
            speed = number_from_text(document["speed"])
            require(speed > 0, "`speed` must be positive")
            prove_captures(beta, delta, epsilon, interval_between(speed, speed))
            claim += f" below {document['speed']}"
        else:
            require(claim in CLAIMS or claim in QUIET, f"the claim {claim!r} is not one that this program can check")
            prove_claim(claim, beta, delta, epsilon)
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError) as error:
        raise BlockRefusal(
            f"the document cannot be checked, perhaps because it is incomplete or malformed: {error}"
        ) from error
    return f"{claim}, δ {' to '.join(document['delta'])}, ε {' to '.join(document['epsilon'])}"


def ends_from_texts(texts: Any) -> Ends:
    """Return both ends of an interval from their texts. Raises BlockRefusal."""
    low, high = (number_from_text(each) for each in texts)
    require(low <= high, "the first end of `delta` and of `epsilon` must not be above the second end")
    return low, high


def main(path: str) -> int:
    """Check the block on each line of a file, and print the results. Return 1 if one is refused, else 0."""
    status = 0
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            try:
                print(f"proved: {check(line)}")
            except BlockRefusal as why:
                print(f"NOT PROVED, line {number}: {why}")
                status = 1
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
