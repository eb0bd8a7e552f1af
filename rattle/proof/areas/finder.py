"""The finder of blocks: prove a claim over a whole block, or over parts of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

from rattle.errors import NotProvedError
from rattle.proof.areas import one_impact, quiet, two_impacts
from rattle.proof.areas.block import CLAIMS, LOUD, QUIET, ClaimedState
from rattle.proof.areas.piece import PlanePiece, hull
from rattle.proof.balls import ball
from rattle.proof.certificate import Ends

DEEPEST = 3  # most halvings of a block in δ


@dataclass
class Prover:
    """Prove claims on blocks at one β. Solutions for B and D are kept and serve all blocks with the same δ."""

    beta: Fraction
    _cells: dict[Ends, tuple[two_impacts.SolutionCell, two_impacts.SolutionCell]] = field(default_factory=dict)

    def require(self, claim: str, delta: Ends, epsilon: Ends, depth: int = 0) -> None:
        """Raise NotProvedError unless the claim holds on the block delta × epsilon, as a whole or in halves of δ."""
        piece = PlanePiece(hull(*map(ball, delta)), hull(*map(ball, epsilon)), ball(self.beta))
        try:
            self._require_of(piece, claim, delta)
        except NotProvedError:
            if depth == DEEPEST:
                raise
            middle = (delta[0] + delta[1]) / 2
            self.require(claim, (delta[0], middle), epsilon, depth + 1)
            self.require(claim, (middle, delta[1]), epsilon, depth + 1)

    def _require_of(self, piece: PlanePiece, claim: str, delta: Ends) -> None:
        if claim in (QUIET, LOUD):
            if quiet.possible(piece) is not (claim == QUIET):
                raise NotProvedError(f"the claim '{claim}' is undecided")
            return
        states = CLAIMS[claim]
        for letter in states.keys() & {"A", "C"}:
            require_state(letter, states[letter], *_of_one_impact(piece, letter, states[letter]))
        for letter in states.keys() & {"B", "D"}:
            if delta not in self._cells:
                self._cells[delta] = two_impacts.cells(piece)
            runs, state = two_impacts.motions(piece, self._cells[delta], letter), states[letter]
            told = state not in (ClaimedState.NONE, ClaimedState.THERE) and len(runs) == 1
            require_state(letter, state, len(runs), two_impacts.attracts(piece, runs[0]) if told else None)


def _of_one_impact(piece: PlanePiece, letter: str, state: ClaimedState) -> tuple[int | None, bool | None]:
    there = one_impact.exists(piece, letter)
    if there and state is not ClaimedState.THERE:
        return 1, one_impact.attracts(piece, letter)
    return None if there is None else int(there), None


def require_state(letter: str, state: ClaimedState, number: int | None, attracts: bool | None) -> None:
    """Raise NotProvedError unless the number of motions (None: unknown) and their stability give the claimed state."""
    if number is None:
        raise NotProvedError(f"whether {letter} exists is undecided")
    if number != (state is not ClaimedState.NONE):
        raise NotProvedError(f"{number} motions {letter} exist, which contradicts the claimed state {state!r}")
    if state in (ClaimedState.ATTRACTING, ClaimedState.SADDLE) and attracts is not (state is ClaimedState.ATTRACTING):
        raise NotProvedError(f"{letter} is not proved to be {state}")
