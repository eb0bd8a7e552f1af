"""The finder proves a claim at all points of a block, by ball arithmetic."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

from rattle.errors import NotProvedError
from rattle.proof.areas import one_impact, quiet_enclosure, two_impacts
from rattle.proof.areas.block import CLAIMS, LOUD, QUIET, ClaimedState
from rattle.proof.areas.piece import PlanePiece, hull
from rattle.proof.balls import ball
from rattle.proof.certificate import Ends

#: Most times that the δ interval of a block is halved before the proof is given up.
DELTA_HALVINGS = 3


@dataclass
class BlockProver:
    """The prover of claims on blocks at one β.

    The prover keeps the cells of B and D (`two_impacts`) for further claims about the same δ interval.
    """

    beta: Fraction
    _cells: dict[Ends, tuple[two_impacts.SolutionCell, two_impacts.SolutionCell]] = field(default_factory=dict)

    def require_claim(self, claim: str, delta: Ends, epsilon: Ends, depth: int = 0) -> None:
        """Prove that the claim holds at all points with δ and ε in these intervals.

        The block is tried as a whole. If this fails, its halves in δ are tried, and so on up to DELTA_HALVINGS times.
        depth: how often the block has been halved already.

        Raises
        ------
        NotProvedError
            If the claim is not proved.
        """
        piece = PlanePiece(hull(*map(ball, delta)), hull(*map(ball, epsilon)), ball(self.beta))
        try:
            self._require_claim_on_whole_piece(piece, claim, delta)
        except NotProvedError:
            if depth == DELTA_HALVINGS:
                raise
            middle = (delta[0] + delta[1]) / 2
            self.require_claim(claim, (delta[0], middle), epsilon, depth + 1)
            self.require_claim(claim, (middle, delta[1]), epsilon, depth + 1)

    def _require_claim_on_whole_piece(self, piece: PlanePiece, claim: str, delta: Ends) -> None:
        """Raise NotProvedError unless the claim is proved on a piece as a whole, without cutting it."""
        if claim in (QUIET, LOUD):
            if quiet_enclosure.is_quiet_possible(piece) is not (claim == QUIET):
                raise NotProvedError(f'the claim "{claim}" is not proved on the whole block: try a smaller block')
            return
        states = CLAIMS[claim]
        for letter in states.keys() & {"A", "C"}:
            require_claimed_state(letter, states[letter], *_prove_number_and_stability(piece, letter, states[letter]))
        for letter in states.keys() & {"B", "D"}:
            if delta not in self._cells:
                self._cells[delta] = two_impacts.initial_cells(piece)
            runs, state = two_impacts.enclose_motions_in_cells(piece, self._cells[delta], letter), states[letter]
            claims_stability = state not in (ClaimedState.NONE, ClaimedState.THERE) and len(runs) == 1
            attracts = two_impacts.attracts(piece, runs[0]) if claims_stability else None
            require_claimed_state(letter, state, len(runs), attracts)


def _prove_number_and_stability(piece: PlanePiece, letter: str, state: ClaimedState) -> tuple[int | None, bool | None]:
    """Return how many motions A (or C) exist, and whether the motion attracts.

    Returns
    -------
    tuple[int | None, bool | None]
        The number of motions; None if it is not proved. Then True if the motion attracts, False if it is a saddle; None
        if neither is proved, if no motion exists, or if the claimed `state` is THERE.
    """
    exists = one_impact.exists(piece, letter)
    if exists and state is not ClaimedState.THERE:
        return 1, one_impact.attracts(piece, letter)
    return None if exists is None else int(exists), None


def require_claimed_state(letter: str, state: ClaimedState, number: int | None, attracts: bool | None) -> None:
    """Raise NotProvedError unless the number and the stability of the motions with one letter are as claimed.

    Parameters
    ----------
    number : int | None
        Number of these motions at every point of the block, None if it is not proved.
    attracts : bool | None
        True if the motion is proved to attract, False if it is proved to be a saddle, else None.

    Raises
    ------
    NotProvedError
        If they differ from the claimed `state`, or are not proved.
    """
    if number is None:
        raise NotProvedError(f"it is undecided whether {letter} exists on the block: try a smaller block")
    if number != (state is not ClaimedState.NONE):
        raise NotProvedError(
            f"the number of motions {letter} at each point of the block is {number}, which contradicts the claimed "
            f"state {str(state)!r} of {letter}: choose another claim"
        )
    if state in (ClaimedState.ATTRACTING, ClaimedState.SADDLE) and attracts is not (state is ClaimedState.ATTRACTING):
        raise NotProvedError(f"{letter} is not proved to be {state} on the whole block: try a smaller block")
