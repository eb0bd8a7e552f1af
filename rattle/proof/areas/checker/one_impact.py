"""A and C, the motions P(1,1,0): equations (15.1) to (15.4) of docs/proofs.md.

Notation: τ is the phase of the impact; X = ε cos 2πτ, which is negative for A and positive for C; Y = ε sin 2πτ.
"""

from .intervals import IV, ONE, PI, ZERO, Interval, Jet, ParameterBox, is_certainly_less, midpoint, require

#: Shortest part of a flight that is bisected, in forcing periods.
SHORTEST_PART = 2.0**-18
#: Points on each side of the best point so far, in each step of the search for the lowest point of a flight.
SEARCH_POINTS = 32


def epsilon_sine(d: Jet) -> Jet:
    """Return Y = ε sin 2πτ = 2 − δ coth(δ/2), (15.1) of docs/proofs.md, for the damping d."""
    end = d.exp_of_negative()
    return 2 - d * (1 + end) / (1 - end)


def height_at(t: Jet, d: Jet, x: Interval) -> Jet:
    """Return Φ − β at a time t after the impact, (15.3) of docs/proofs.md, for δ = d and ε cos 2πτ = x."""
    sine, cosine = t.sine_and_cosine(2)
    y = epsilon_sine(d)
    rest = ((2 - y + d) * (2 * PI)) / d
    return t * (4 * PI) - rest * (1 - (d * t).exp_of_negative()) - (1 - cosine) * x - y * sine


class OneImpactBlock:
    """The motion A or C over a block: all δ of the interval d, and low ≤ ε² ≤ high.

    has_solution: True if (15.1) and (15.2) of docs/proofs.md are proved to have a solution at all points of the block.
    has_no_solution: True if they are proved to have a solution at none. x: an enclosure of X = ε cos 2πτ over the
    block, τ being the phase of the impact.
    """

    def __init__(self, letter: str, d: Interval, beta: Interval, low: Interval, high: Interval) -> None:
        box = ParameterBox(ZERO, d)
        y = box.enclose_by_mean_value(epsilon_sine(box.centre[1]).x, epsilon_sine(box.jets[1]))
        self.d, self.beta, self.letter = d, beta, letter
        self.has_solution, self.has_no_solution = is_certainly_less(y**2, low), is_certainly_less(high, y**2)
        if not self.has_no_solution:
            least = (low - y**2).a if self.has_solution else ZERO
            x = IV.sqrt(IV.mpf([least.a, (high - y**2).b]))
            self.x = x if letter == "C" else -x

    def exists(self) -> bool:
        """Return True if the motion exists at all points of the block, False if at none. Raises BlockRefusal."""
        if self.has_no_solution:
            return False
        if self.has_solution and self.stays_between_walls():
            return True
        require(self.passes_sigma_minus(), f"it is undecided whether {self.letter} exists on the whole block")
        return False

    def stays_between_walls(self) -> bool:
        """Return whether −2β < Φ − β < 0 is proved at all times between two impacts, for all points of the block."""
        parts = [(ZERO, ONE)]
        while parts:
            low, high = parts.pop()
            box = ParameterBox(IV.mpf([low.a, high.b]), self.d)
            over = height_at(*box.jets, self.x)
            y = box.enclose_by_mean_value(height_at(*box.centre, self.x).x, over)
            # Φ − β is 0 at both impacts, so next to an impact the sign of Φ' proves Φ − β < 0
            leaves = (
                is_certainly_less(over.s, ZERO)
                if low == 0
                else is_certainly_less(ZERO, over.s)
                if high == 1
                else is_certainly_less(y, ZERO)
            )
            if not (leaves and is_certainly_less(-2 * self.beta, y)):
                if is_certainly_less(high - low, SHORTEST_PART):
                    return False
                half = midpoint(box.s)
                parts += [(low, half), (half, high)]
        return True

    def passes_sigma_minus(self) -> bool:
        """Return whether there is a time t at which the flight is proved to be beyond Σ⁻ at all points of the block.

        Returns
        -------
        bool
            False if that is not proved.

        Raises
        ------
        BlockRefusal
            If the guess of t, the time of the lowest point, is not between the impacts.
        """
        t, step, d = ONE / 2, ONE / 2, Jet(midpoint(self.d))
        for _ in range(3):
            places = [midpoint(t + step * i / SEARCH_POINTS) for i in range(1 - SEARCH_POINTS, SEARCH_POINTS)]
            t = min(places, key=lambda each: float(height_at(Jet(each), d, self.x.a).x.mid.a))
            step = step / SEARCH_POINTS
        require(
            is_certainly_less(ZERO, t) and is_certainly_less(t, ONE),
            "the lowest point of the flight was not found between its ends",
        )
        box = ParameterBox(t, self.d)
        return is_certainly_less(
            box.enclose_by_mean_value(height_at(*box.centre, self.x.a).x, height_at(*box.jets, self.x.a)),
            -2 * self.beta,
        )

    def attracts(self) -> bool:
        """Return True if the motion attracts at all points of the block, False if at none. Raises BlockRefusal."""
        box = ParameterBox(ZERO, self.d)

        def epsilon_cosine_at_flip(d: Jet) -> Jet:
            """Return the X = ε cos 2πτ at which C flips, (15.4) of docs/proofs.md; C attracts if 0 < X < this value."""
            end = d.exp_of_negative()
            return d * d * (1 + end) / (1 - end) * (1 / (2 * PI))

        flip = box.enclose_by_mean_value(epsilon_cosine_at_flip(box.centre[1]).x, epsilon_cosine_at_flip(box.jets[1]))
        inside = is_certainly_less(ZERO, self.x) and is_certainly_less(self.x, flip)
        outside = is_certainly_less(self.x, ZERO) or is_certainly_less(flip, self.x)
        require(inside or outside, f"it is undecided whether {self.letter} attracts on the whole block")
        return inside
