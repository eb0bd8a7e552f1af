"""Quiet motion: whether it is possible, and below which speed it captures."""

from fractions import Fraction

from .intervals import IV, PI, ZERO, Interval, decayed, interval_between, less, require, sine_and_cosine_of

PARTS = 192  # of a period
UNDONE = IV.mpf(96) / 100  # of the damping, at most
UP = IV.mpf([1 - 2.0**-50, 1 + 2.0**-50])  # by which a logarithm, or a root by it, may be off


def require_possible(d: Interval, e: Interval, possible: bool) -> None:
    """Refuse unless ε √(4π² + δ²) is below (above) 2δ at the worst corner."""
    low, high = e.b * IV.sqrt(4 * PI**2 + d.a**2), 2 * d.a
    if not possible:
        low, high = 2 * d.b, e.a * IV.sqrt(4 * PI**2 + d.b**2)
    require(less(low, high), "it is not proved on which side of the quiet limit it is")


class Capture:
    """Bounces while g = 4πδ (1 − r cos θ) > 0, in units in which its mean is 1."""

    def __init__(self, d: Interval, e: Interval, beta: Interval) -> None:
        self.d, self.beta = d, beta
        self.r = e * IV.sqrt(4 * PI**2 + d**2) / (2 * d)
        self.weakest = 1 - self.r.b
        require(less(ZERO, self.weakest), "quiet is not proved to be possible")

    def require_below(self, speed: Interval) -> None:
        """Refuse unless v³/g falls from each bounce to the next, if the first is slower than this."""
        places = [interval_between(Fraction(i, PARTS), Fraction(i + 1, PARTS)) for i in range(PARTS)]
        longest = ZERO
        for part in places:  # v³/g is at most what it is where g is least
            v = speed / (4 * PI * self.d) * IV.exp(IV.ln(self.force(part)[0].b / self.weakest) / 3) * UP
            half = self.half(part, v.b)
            longest = half if less(longest, half) else longest
        h = (longest / (1 - self.d * longest)).b
        for part in places:
            require(less(h**2 * self.growth(part, h), 2 * UNDONE * self.d), "a bounce may be higher than the last")

    def force(self, t: Interval) -> tuple[Interval, Interval, Interval]:
        """Return g, and r times sine and cosine of the time since it was least."""
        sine, cosine = sine_and_cosine_of(2 * PI * t)
        return 1 - self.r * cosine, self.r * sine, self.r * cosine

    def half(self, t: Interval, v: Interval) -> Interval:
        """Half of what a bounce from here takes at most, in units in which it is not damped."""
        half = found = (v / self.weakest).b * 1.001
        for _ in range(4):
            require(less(2 * half * self.d, 1), "bounces may last too long")
            time = (IV.ln(1 / (1 - 2 * half * self.d)) * UP).b
            least = self.force(IV.mpf([t.a, (t + time / self.d).b]))[0].a
            require(less(v, half * least), "bounces may last too long")
            require(less(v**2 * PI * self.d, self.beta * least), "a bounce may reach the other wall")
            found, half = half, (v / least).b * 1.001
        return found

    def growth(self, t: Interval, h: Interval) -> Interval:
        """Q, by the derivatives of the logarithm of the force."""
        late, early = (IV.ln(1 / (1 - self.d * h)) * UP).b, (IV.ln(1 + self.d * h) * UP).b
        span = IV.mpf([-early, late])
        one, _, _, centre = self.logarithm(t, ZERO)
        p1, p2, p3, size = self.logarithm(t + span / self.d, span)
        second, third = size * (p2 + p1**2) / centre, size * (p3 + 3 * p1 * p2 + p1**3) / centre
        part = IV.mpf([0, (h**2).b])
        below = 1 + part * second / 6
        ratio = (one / 3 + part * third / 30) / below
        more = 1 / (1 - part * ratio**2)
        return (third / 5 - one * second / 3) / below + 2 * ratio**3 * IV.mpf([1, more.b]) - p3 / 3

    def logarithm(self, t: Interval, x: Interval) -> tuple[Interval, Interval, Interval, Interval]:
        """Return three derivatives of ln (e^(2x) g), x = δ(t − t₀), along what is not damped; and e^(2x) g."""
        w, (g, sine, cosine) = decayed(-x), self.force(t)
        k, d = 2 * PI, self.d
        f1, b, c = k * sine / g, k**2 * cosine / g, -(k**3) * sine / g  # g', g'', g''' over g
        f2, f3 = b - f1**2, c - 3 * f1 * b + 2 * f1**3
        first = 2 * d + f1
        return w * first, w**2 * (d * first + f2), w**3 * (2 * d**2 * first + 3 * d * f2 + f3), w**2 * g
