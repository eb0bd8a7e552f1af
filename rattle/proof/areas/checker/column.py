"""Bisect s, the time from Σ⁺ to Σ⁻, to find the motions B and D over one interval of δ, and whether they attract."""

from fractions import Fraction
from itertools import groupby

from .half_way import stability_margins
from .intervals import ZERO, Interval, interval_between, is_certainly_less, midpoint, require
from .two_impacts import TwoImpactCell

#: A cell is not halved if its width in s is at most this share of the width of the δ interval.
SHARE = Fraction(1, 64)
Part = tuple[Fraction, Fraction]


class TwoImpactColumn:
    """The cells (`TwoImpactCell`) with 0 ≤ s ≤ 1 over one interval of δ, kept for further claims about this interval.

    s is the time from Σ⁺ to Σ⁻.
    """

    def __init__(self, delta: Part, beta: Fraction) -> None:
        self.d, self.beta = interval_between(*delta), interval_between(beta, beta)
        self.narrowest = SHARE * (delta[1] - delta[0])
        self.cells: dict[Part, TwoImpactCell] = {}

    def cell_between(self, low: Fraction, high: Fraction) -> TwoImpactCell:
        """Return the cell low ≤ s ≤ high, s being the time from Σ⁺ to Σ⁻."""
        if (low, high) not in self.cells:
            self.cells[low, high] = TwoImpactCell(interval_between(low, high), self.d, self.beta)
        return self.cells[low, high]

    def enclose_motions_in_runs(self, slope: int, low: Interval, high: Interval) -> list[list[Part]]:
        """Enclose the times s from Σ⁺ to Σ⁻ of all motions B (slope −1) or D (slope 1) that have low ≤ ε² ≤ high.

        ε² falls as s grows along the solutions B, and rises along D.

        Returns
        -------
        list[list[Part]]
            For each motion a run: neighbouring parts of 0 ≤ s ≤ 1 that contain its s.

        Raises
        ------
        BlockRefusal
            If the number of motions is not proved to be the same at all δ and ε², or a motion may have s = 0 or s = 1.
        """
        decided, parts = [], [(Fraction(0), Fraction(1))]
        while parts:
            first, last = parts.pop()
            answer = self.cell_between(first, last).are_all_solutions_of_type(slope, low, high)
            if answer is None:
                wide = last - first > self.narrowest
                require(
                    wide,
                    f"it is undecided whether a motion B or D reaches Σ⁻ {float(first):.4f} forcing periods after Σ⁺",
                )
                parts += [((first + last) / 2, last), (first, (first + last) / 2)]
            else:
                decided.append((answer, (first, last)))
        require(
            not decided[0][0] and not decided[-1][0],
            "a motion B or D may have both impacts at the same phase",
        )
        runs = [[part for _, part in group] for answer, group in groupby(decided, lambda each: each[0]) if answer]
        return [run for run in runs if self.crosses_block(run, slope, low, high)]

    def crosses_block(self, run: list[Part], slope: int, low: Interval, high: Interval) -> bool:
        """Return whether ε²(s) takes each value from low to high exactly once along a run, at every δ.

        s is the time from Σ⁺ to Σ⁻. run: neighbouring parts of 0 ≤ s ≤ 1 in order, on which ε²(s) is monotone.
        slope: 1 if ε² rises on these parts, −1 if it falls.

        Returns
        -------
        bool
            False if ε²(s) takes none of the values.

        Raises
        ------
        BlockRefusal
            If ε²(s) at an end of the run is not proved to be below all these values, nor proved to be above them.
        """
        # The parts next to the run have no motion with low ≤ ε² ≤ high. So at each end of the run ε² is outside this
        # range at every δ of the block. As ε² is continuous in δ, it stays on one side of the range, and one δ shows
        # which side that is.
        sides = []
        for s in (run[0][0], run[-1][1]):
            square = TwoImpactCell(interval_between(s, s), midpoint(self.d), self.beta).square.x
            require(
                is_certainly_less(square, low) or is_certainly_less(high, square),
                "a curve of solutions is not proved to leave the block in ε",
            )
            sides.append(1 if is_certainly_less(high, square) else -1)
        return sides == [-slope, slope]

    def attracts(self, run: list[Part], low: Interval, high: Interval) -> bool:
        """Return True if the motion B or D in a run attracts at all points of the block, False if at none.

        run: the parts of 0 ≤ s ≤ 1 that contain the motion's time s from Σ⁺ to Σ⁻. low, high: the ends of the block
        in ε².

        Returns
        -------
        bool
            The proved stability.

        Raises
        ------
        BlockRefusal
            If the stability is not proved to be the same on the whole block.
        """
        verdicts, parts = set(), list(run)
        while parts:
            first, last = parts.pop()
            cell = self.cell_between(first, last)
            if cell.has_no_motion(low, high):
                continue
            above, below = (each.x for each in cell.enclose(stability_margins))
            inside = is_certainly_less(ZERO, above) and is_certainly_less(ZERO, below)
            if inside or is_certainly_less(above, ZERO) or is_certainly_less(below, ZERO):
                verdicts.add(inside)
                require(len(verdicts) == 1, "B or D is not proved to have the same stability on the whole block")
            else:
                require(last - first > self.narrowest, "it is undecided whether B or D attracts on the whole block")
                parts += [(first, (first + last) / 2), ((first + last) / 2, last)]
        return True in verdicts
