"""Prove that quiet running is possible, and a speed below which every motion becomes quiet (lemmas 20 and 21)."""

from fractions import Fraction

from .intervals import IV, PI, ZERO, Interval, decayed, interval_between, less, require, sine_and_cosine_of

PARTS = 192  # intervals into which the forcing period is cut
UNDONE = IV.mpf(96) / 100  # at most this share of the damping is compensated by growth
UP = IV.mpf([1 - 2.0**-50, 1 + 2.0**-50])  # factor that widens logarithms, and roots computed from them


def require_possible(d: Interval, e: Interval, possible: bool) -> None:
    """Raise BlockRefused unless ε √(4π² + δ²) stays below 2δ over the block (above it, if `possible` is false)."""
    low, high = e.b * IV.sqrt(4 * PI**2 + d.a**2), 2 * d.a
    if not possible:
        low, high = 2 * d.b, e.a * IV.sqrt(4 * PI**2 + d.b**2)
    require(less(low, high), "the side of the quiet limit on which the block lies is undecided")


class Capture:
    """Bounces while the contact force g = 4πδ (1 − r cos θ) is positive. Units: the mean of g is 1."""

    def __init__(self, d: Interval, e: Interval, beta: Interval) -> None:
        self.d, self.beta = d, beta
        self.r = e * IV.sqrt(4 * PI**2 + d**2) / (2 * d)
        self.weakest = 1 - self.r.b
        require(less(ZERO, self.weakest), "the contact force is not proved positive at all times")

    def require_below(self, speed: Interval) -> None:
        """Raise BlockRefused unless v³/g falls at every bounce of all motions that start slower than `speed`."""
        places = [interval_between(Fraction(i, PARTS), Fraction(i + 1, PARTS)) for i in range(PARTS)]
        longest = ZERO
        for part in places:  # v³/g of the first bounce is largest where g is least
            v = speed / (4 * PI * self.d) * IV.exp(IV.ln(self.force(part)[0].b / self.weakest) / 3) * UP
            half = self.half(part, v.b)
            longest = half if less(longest, half) else longest
        h = (longest / (1 - self.d * longest)).b
        for part in places:
            require(
                less(h**2 * self.growth(part, h), 2 * UNDONE * self.d),
                "v³/g is not proved to fall from each bounce to the next",
            )

    def force(self, t: Interval) -> tuple[Interval, Interval, Interval]:
        """Return g, r sin θ and r cos θ, where θ is the phase since the minimum of g."""
        sine, cosine = sine_and_cosine_of(2 * PI * t)
        return 1 - self.r * cosine, self.r * sine, self.r * cosine

    def half(self, t: Interval, v: Interval) -> Interval:
        """Bound half the duration of a bounce that begins at time t with speed v, in the time x without damping."""
        half = found = (v / self.weakest).b * 1.001
        for _ in range(4):
            require(less(2 * half * self.d, 1), "the duration of bounces is not bounded")
            time = (IV.ln(1 / (1 - 2 * half * self.d)) * UP).b
            least = self.force(IV.mpf([t.a, (t + time / self.d).b]))[0].a
            require(less(v, half * least), "the duration of bounces is not bounded")
            require(less(v**2 * PI * self.d, self.beta * least), "a bounce is not proved to end before it reaches Σ⁻")
            found, half = half, (v / least).b * 1.001
        return found

    def growth(self, t: Interval, h: Interval) -> Interval:
        """Enclose Q of docs/proofs.md, lemma 20, from the derivatives of the logarithm of the force."""
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
        """Return the first three derivatives of ln a by the undamped time, and a = e^(2x) g, where x = δ(t − t₀)."""
        w, (g, sine, cosine) = decayed(-x), self.force(t)
        k, d = 2 * PI, self.d
        f1, b, c = k * sine / g, k**2 * cosine / g, -(k**3) * sine / g  # g'/g, g''/g and g'''/g
        f2, f3 = b - f1**2, c - 3 * f1 * b + 2 * f1**3
        first = 2 * d + f1
        return w * first, w**2 * (d * first + f2), w**3 * (2 * d**2 * first + 3 * d * f2 + f3), w**2 * g
