"""Check certificates of blocks of the plane. From the folder's parent run `python -m checker.check FILE`.

Each claim is proved again by another method than the finder's: other intervals, unknowns and derivatives.
docs/proofs.md has the lemmas.
"""

import json
import sys
from fractions import Fraction
from functools import lru_cache
from typing import Any

from .intervals import IV, BlockRefused, Interval, exact, interval_between, require
from .one_impact import OneImpact
from .quiet import Capture, require_possible
from .two_impacts import Column

DEEPEST, DEEPEST_CAPTURE = 5, 2  # most halvings of a block in δ; for a claim of capture in ε and δ alternately
NONE, THERE, ATTRACTING, SADDLE = "none", "there", "attracting", "a saddle"
#: The states of A, B, C and D in each region of the paper.
REGIONS = {
    "I": {"A": NONE, "B": NONE, "C": NONE, "D": NONE},
    "II": {"A": SADDLE, "B": NONE, "C": THERE, "D": NONE},
    "III": {"A": SADDLE, "B": SADDLE, "C": THERE, "D": ATTRACTING},
    "IV": {"A": SADDLE, "B": SADDLE, "C": THERE, "D": SADDLE},
    "V": {"A": SADDLE, "B": NONE, "C": NONE, "D": THERE},
}
CLAIMS = REGIONS | {
    f"{letter} {words}": {letter: state}
    for letter in "CD" for words, state in (("attracts", ATTRACTING), ("is a saddle", SADDLE), ("is not there", NONE))
}  # fmt: skip
QUIET, CAPTURES = {"quiet is possible": True, "quiet is impossible": False}, "quiet captures"
Ends = tuple[Fraction, Fraction]
column = lru_cache(maxsize=64)(Column)  # all claims of a column of δ share its solutions


def prove_claim(claim: str, beta: Fraction, delta: Ends, epsilon: Ends, depth: int = 0) -> None:
    """Raise BlockRefused unless a claim holds at all points of a block. Where the whole fails, try its halves."""
    try:
        prove_whole(claim, beta, delta, epsilon)
    except BlockRefused:
        if depth == DEEPEST:
            raise
        half = (delta[0] + delta[1]) / 2
        for part in ((delta[0], half), (half, delta[1])):
            prove_claim(claim, beta, part, epsilon, depth + 1)


def prove_whole(claim: str, beta: Fraction, delta: Ends, epsilon: Ends) -> None:
    """Raise BlockRefused unless a claim is proved over the whole block in one step."""
    d, e = interval_between(*delta), interval_between(*epsilon)
    if claim in QUIET:
        return require_possible(d, e, QUIET[claim])
    squares = IV.mpf((e**2).a), IV.mpf((e**2).b)
    for letter, state in CLAIMS[claim].items():
        if letter in "AC":
            found = check_one(letter, state, d, interval_between(beta, beta), squares)
        else:
            found = two(1 if letter == "D" else -1, state, column(delta, beta), squares)
        require(found == state, f"the state of {letter} is {found!r}, not {state!r} as claimed")
    return None


def prove_captured(beta: Fraction, delta: Ends, epsilon: Ends, speed: Interval, depth: int = 0) -> None:
    """Raise BlockRefused unless quiet captures below `speed` on a block. Where the whole fails, try its halves."""
    try:
        Capture(interval_between(*delta), interval_between(*epsilon), interval_between(beta, beta)).require_below(speed)
    except BlockRefused:
        if depth == DEEPEST_CAPTURE:
            raise
        cut = epsilon if depth % 2 == 0 else delta
        half = (cut[0] + cut[1]) / 2
        for part in ((cut[0], half), (half, cut[1])):
            both = (delta, part) if depth % 2 == 0 else (part, epsilon)
            prove_captured(beta, *both, speed, depth + 1)


def check_one(letter: str, state: str, d: Interval, beta: Interval, squares: tuple[Interval, Interval]) -> str:
    """Return the state of A or C over a block."""
    motion = OneImpact(letter, d, beta, *squares)
    if not motion.there():
        return NONE
    return THERE if state in (THERE, NONE) else ATTRACTING if motion.attracts() else SADDLE


def two(rises: int, state: str, all_s: Column, squares: tuple[Interval, Interval]) -> str:
    """Return the state of B (rises −1) or D (rises 1) over a block."""
    runs = all_s.runs(rises, *squares)
    require(len(runs) < 2, f"{len(runs)} motions of this letter exist, so its state is ambiguous")
    if not runs:
        return NONE
    return THERE if state in (THERE, NONE) else ATTRACTING if all_s.attracts(runs[0], *squares) else SADDLE


def check(text: str) -> str:
    """Prove the claim of a block's certificate and return it as a sentence. Raises BlockRefused."""
    try:
        document = json.loads(text)
        require((document["format"], document["theorem"]) == (1, "area"), "the certificate's format is unknown")
        claim, beta = document["claim"], exact(document["beta"])
        delta, epsilon = (ends_of(document[name]) for name in ("delta", "epsilon"))
        require(beta > 0 and delta[0] > 0, "a parameter is not positive")
        if claim == CAPTURES:
            speed = exact(document["speed"])
            require(speed > 0, "the claimed speed is not positive")
            prove_captured(beta, delta, epsilon, interval_between(speed, speed))
            claim += f" below {document['speed']}"
        else:
            require(claim in CLAIMS or claim in QUIET, f"the claim {claim!r} is unknown")
            prove_claim(claim, beta, delta, epsilon)
    except (LookupError, TypeError, ValueError, ArithmeticError, AttributeError, RecursionError) as error:
        raise BlockRefused(f"the certificate cannot be read: {error}") from error
    return f"{claim}, δ {' to '.join(document['delta'])}, ε {' to '.join(document['epsilon'])}"


def ends_of(texts: Any) -> Ends:
    """Return the two ends of an interval as exact fractions from their texts."""
    low, high = (exact(each) for each in texts)
    require(low <= high, "the lower end of an interval exceeds its upper end")
    return low, high


def main(path: str) -> int:
    """Check each line of a file and print its proved claim. Returns 1 if a line is refused, else 0."""
    status = 0
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(file, 1):
            try:
                print(f"proved: {check(line)}")
            except BlockRefused as why:
                print(f"NOT PROVED, line {number}: {why}")
                status = 1
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
