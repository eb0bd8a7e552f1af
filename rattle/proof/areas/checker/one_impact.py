"""A and C, which are P(1,1,0): X = ε cos 2πτ < 0 for A, > 0 for C."""

from .intervals import IV, ONE, PI, ZERO, Interval, Jet, ParameterBox, less, middle, require

SHORTEST, PLACES = 2.0**-18, 32  # a part of a flight; of a search, on either side


def sine_of(d: Jet) -> Jet:
    """Y = ε sin 2πτ."""
    end = d.decay()
    return 2 - d * (1 + end) / (1 - end)


def height_at(t: Jet, d: Jet, x: Interval) -> Jet:
    """Φ − β at t after the impact, which leaves with −2πδ."""
    sine, cosine = t.turn(2)
    y = sine_of(d)
    rest = ((2 - y + d) * (2 * PI)) / d
    return t * (4 * PI) - rest * (1 - (d * t).decay()) - (1 - cosine) * x - y * sine


class OneImpact:
    """A or C over a block: at all δ of an interval, with ε² between two numbers."""

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
        """Return whether it is there at all points; else it is at none."""
        if self.unborn:
            return False
        if self.born and self.stays():
            return True
        require(self.touches(), f"it is not told whether {self.letter} is there")
        return False

    def stays(self) -> bool:
        """Return whether −2β < Φ − β < 0 between two impacts."""
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
        """Return whether some place of the flight is beyond Σ⁻: looked for at one point, proved for all."""
        t, step, d = ONE / 2, ONE / 2, Jet(middle(self.d))
        for _ in range(3):
            places = [middle(t + step * i / PLACES) for i in range(1 - PLACES, PLACES)]
            t = min(places, key=lambda each: float(height_at(Jet(each), d, self.x.a).x.mid.a))
            step = step / PLACES
        require(less(ZERO, t) and less(t, ONE), "a flight is lowest at its ends")
        box = ParameterBox(t, self.d)
        return less(box.about(height_at(*box.centre, self.x.a).x, height_at(*box.jets, self.x.a)), -2 * self.beta)

    def attracts(self) -> bool:
        """Return whether both multipliers are inside the unit circle everywhere; else one is outside everywhere."""
        box = ParameterBox(ZERO, self.d)

        def ratio(d: Jet) -> Jet:  # X less than this, 2(1 + E)δ²/4π(1 − E), and more than 0
            end = d.decay()
            return d * d * (1 + end) / (1 - end) * (1 / (2 * PI))

        flip = box.about(ratio(box.centre[1]).x, ratio(box.jets[1]))
        inside = less(ZERO, self.x) and less(self.x, flip)
        outside = less(self.x, ZERO) or less(flip, self.x)
        require(inside or outside, f"it is not told whether {self.letter} attracts")
        return inside
