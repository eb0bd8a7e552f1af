"""The motions A and C, which are P(1,1,0), with X = ε cos 2πτ: A has X < 0 and C has X > 0."""

from .intervals import IV, ONE, PI, ZERO, Interval, Jet, ParameterBox, less, middle, require

SHORTEST, PLACES = 2.0**-18, 32  # shortest part of a flight, in forcing periods; search points on either side


def sine_of(d: Jet) -> Jet:
    """Return Y = ε sin 2πτ of A and C, which δ alone determines."""
    end = d.decay()
    return 2 - d * (1 + end) / (1 - end)


def height_at(t: Jet, d: Jet, x: Interval) -> Jet:
    """Return Φ − β at the time t after the impact, which the gear leaves with velocity −2πδ."""
    sine, cosine = t.turn(2)
    y = sine_of(d)
    rest = ((2 - y + d) * (2 * PI)) / d
    return t * (4 * PI) - rest * (1 - (d * t).decay()) - (1 - cosine) * x - y * sine


class OneImpact:
    """The motion A or C over a block: all δ of an interval and all ε² between two numbers."""

    def __init__(self, letter: str, d: Interval, beta: Interval, low: Interval, high: Interval) -> None:
        box = ParameterBox(ZERO, d)
        y = box.about(sine_of(box.centre[1]).x, sine_of(box.jets[1]))
        self.d, self.beta, self.letter = d, beta, letter
        self.born, self.unborn = less(y**2, low), less(high, y**2)
        if not self.unborn:
            least = (low - y**2).a if self.born else ZERO
            x = IV.sqrt(IV.mpf([least.a, (high - y**2).b]))
            self.x = x if letter == "C" else -x

    def there(self) -> bool:
        """Return whether the motion exists at all points of the block (True) or at none. Refuses an undecided block."""
        if self.unborn:
            return False
        if self.born and self.stays():
            return True
        require(self.touches(), f"whether {self.letter} exists is undecided")
        return False

    def stays(self) -> bool:
        """Return whether −2β < Φ − β < 0 is proved between two impacts."""
        parts = [(ZERO, ONE)]
        while parts:
            low, high = parts.pop()
            box = ParameterBox(IV.mpf([low.a, high.b]), self.d)
            over = height_at(*box.jets, self.x)
            y = box.about(height_at(*box.centre, self.x).x, over)
            leaves = less(over.s, ZERO) if low == 0 else less(ZERO, over.s) if high == 1 else less(y, ZERO)
            if not (leaves and less(-2 * self.beta, y)):
                if less(high - low, SHORTEST):
                    return False
                half = middle(box.s)
                parts += [(low, half), (half, high)]
        return True

    def touches(self) -> bool:
        """Return whether the flight is proved to pass Σ⁻ at all points of the block.

        The time of its lowest point is searched at one δ; the proof at that time covers every δ.

        Returns
        -------
        bool
            False means undecided.
        """
        t, step, d = ONE / 2, ONE / 2, Jet(middle(self.d))
        for _ in range(3):
            places = [middle(t + step * i / PLACES) for i in range(1 - PLACES, PLACES)]
            t = min(places, key=lambda each: float(height_at(Jet(each), d, self.x.a).x.mid.a))
            step = step / PLACES
        require(less(ZERO, t) and less(t, ONE), "no lowest point was found inside the flight")
        box = ParameterBox(t, self.d)
        return less(box.about(height_at(*box.centre, self.x.a).x, height_at(*box.jets, self.x.a)), -2 * self.beta)

    def attracts(self) -> bool:
        """Return whether both multipliers lie inside the unit circle. Refuses a block where this is undecided.

        Returns
        -------
        bool
            True if both lie inside at all points, False if one lies outside at all points.
        """
        box = ParameterBox(ZERO, self.d)

        def ratio(d: Jet) -> Jet:  # C attracts where 0 < X < 2(1 + E)δ²/4π(1 − E)
            end = d.decay()
            return d * d * (1 + end) / (1 - end) * (1 / (2 * PI))

        flip = box.about(ratio(box.centre[1]).x, ratio(box.jets[1]))
        inside = less(ZERO, self.x) and less(self.x, flip)
        outside = less(self.x, ZERO) or less(flip, self.x)
        require(inside or outside, f"whether {self.letter} attracts is undecided")
        return inside
