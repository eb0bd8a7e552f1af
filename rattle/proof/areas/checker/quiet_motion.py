"""Quiet motion: whether it is possible (20.1), and below which speed every motion becomes quiet (Lemma 21).

The equations and the lemma are in docs/proofs.md.
"""

from fractions import Fraction

from .intervals import (
    IV,
    PI,
    ZERO,
    Interval,
    exp_of_negative,
    interval_between,
    is_certainly_less,
    require,
    sine_and_cosine_of,
)

#: Number of parts of a forcing period; the bounds are computed over each part.
PARTS = 192
#: The proof requires h²Q < GROWTH_SHARE · 2δ. By (20.5) of docs/proofs.md v³/g falls at each impact if h²Q < 2δ.
GROWTH_SHARE = IV.mpf(96) / 100
#: Factor that widens mpmath's logarithms, and cube roots e^(logarithm/3), by 2⁻⁵⁰ of their size, against rounding.
LOG_WIDENING = IV.mpf([1 - 2.0**-50, 1 + 2.0**-50])


def require_side_of_quiet_limit(d: Interval, e: Interval, below: bool) -> None:
    """Raise BlockRefusal unless ε is proved to be below the quiet limit (or above, if `below` is False) on the block.

    By (20.1) of docs/proofs.md quiet motion is possible below the quiet limit only.
    """
    low, high = e.b * IV.sqrt(4 * PI**2 + d.a**2), 2 * d.a
    if not below:
        low, high = 2 * d.b, e.a * IV.sqrt(4 * PI**2 + d.b**2)
    require(is_certainly_less(low, high), "the block is not proved to be on the claimed side of the quiet limit")


class BounceBounds:
    """Bounds of bounces on Σ⁺ over a block below the quiet limit, by Lemmas 20 and 21 of docs/proofs.md.

    Speeds and the contact force g are in units in which the mean of g is 1: g = 1 − r cos θ > 0, where θ is 2π times
    the time after a minimum of g. r: ε divided by the quiet limit. force_lower_bound: a lower bound of g.
    """

    def __init__(self, d: Interval, e: Interval, beta: Interval) -> None:
        self.d, self.beta = d, beta
        self.r = e * IV.sqrt(4 * PI**2 + d**2) / (2 * d)
        self.force_lower_bound = 1 - self.r.b
        require(is_certainly_less(ZERO, self.force_lower_bound), "the block is not proved to be below the quiet limit")

    def require_captures_below(self, speed: Interval) -> None:
        """Raise BlockRefusal unless all motions that leave Σ⁺ slower than `speed` are proved to become quiet.

        By Lemma 21 of docs/proofs.md a motion becomes quiet if v³/g falls at each of its impacts, where v is the speed
        after the impact and g the contact force at the impact.
        """
        places = [interval_between(Fraction(i, PARTS), Fraction(i + 1, PARTS)) for i in range(PARTS)]
        longest = ZERO
        # if v³/g falls from impact to impact, v³/g ≤ speed³/(least g), and v ≤ speed (g/(least g))^(1/3)
        for part in places:
            v = (
                speed
                / (4 * PI * self.d)
                * IV.exp(IV.ln(self.force_terms(part)[0].b / self.force_lower_bound) / 3)
                * LOG_WIDENING
            )
            half = self.half_duration_bound(part, v.b)
            longest = half if is_certainly_less(longest, half) else longest
        h = (longest / (1 - self.d * longest)).b
        for part in places:
            require(
                is_certainly_less(h**2 * self.growth_coefficient(part, h), 2 * GROWTH_SHARE * self.d),
                "v³/g (v: speed, g: contact force) may grow from one impact to the next",
            )

    def force_terms(self, t: Interval) -> tuple[Interval, Interval, Interval]:
        """Return the contact force g = 1 − r cos θ, and r sin θ and r cos θ, a time t after a minimum of g.

        θ is 2πt, and r is ε divided by the quiet limit.

        Returns
        -------
        tuple[Interval, Interval, Interval]
            Enclosures for all times in t.
        """
        sine, cosine = sine_and_cosine_of(2 * PI * t)
        return 1 - self.r * cosine, self.r * sine, self.r * cosine

    def half_duration_bound(self, t: Interval, v: Interval) -> Interval:
        """Return a bound of half the duration of bounces that start at times in t with speeds ≤ v.

        The duration is in the time x of (20.2), docs/proofs.md, and v in units in which the mean contact force is 1.

        Returns
        -------
        Interval
            The bound.

        Raises
        ------
        BlockRefusal
            If no bound is found, or a bounce may reach Σ⁻.
        """
        half = found = (v / self.force_lower_bound).b * 1.001
        for _ in range(4):
            require(is_certainly_less(2 * half * self.d, 1), "the duration of a bounce is not bounded")
            time = (IV.ln(1 / (1 - 2 * half * self.d)) * LOG_WIDENING).b
            least = self.force_terms(IV.mpf([t.a, (t + time / self.d).b]))[0].a
            require(is_certainly_less(v, half * least), "the duration of a bounce is not bounded")
            require(is_certainly_less(v**2 * PI * self.d, self.beta * least), "a bounce may reach Σ⁻")
            found, half = half, (v / least).b * 1.001
        return found

    def growth_coefficient(self, t: Interval, h: Interval) -> Interval:
        """Return an enclosure of Q, (20.4) of docs/proofs.md, for bounces whose middle is at a time in t.

        h: an upper bound of half the duration of the bounces, in the time x of (20.2). The middle is where x = 0.

        Returns
        -------
        Interval
            Q.
        """
        late, early = (IV.ln(1 / (1 - self.d * h)) * LOG_WIDENING).b, (IV.ln(1 + self.d * h) * LOG_WIDENING).b
        span = IV.mpf([-early, late])
        one, _, _, centre = self.log_acceleration_derivatives(t, ZERO)
        p1, p2, p3, size = self.log_acceleration_derivatives(t + span / self.d, span)
        second, third = size * (p2 + p1**2) / centre, size * (p3 + 3 * p1 * p2 + p1**3) / centre
        part = IV.mpf([0, (h**2).b])
        below = 1 + part * second / 6
        ratio = (one / 3 + part * third / 30) / below
        more = 1 / (1 - part * ratio**2)
        return (third / 5 - one * second / 3) / below + 2 * ratio**3 * IV.mpf([1, more.b]) - p3 / 3

    def log_acceleration_derivatives(self, t: Interval, z: Interval) -> tuple[Interval, Interval, Interval, Interval]:
        """Return enclosures of three derivatives of ln a by x; the acceleration a and the time x are those of (20.2).

        (20.2) is in docs/proofs.md: a = e^(2z) g, with the contact force g. t: the time after a minimum of g.
        z: δ(t − t₀), where x = 0 at the time t₀.

        Returns
        -------
        tuple[Interval, Interval, Interval, Interval]
            The first, second and third derivative of ln a, then a itself.
        """
        w, (g, sine, cosine) = exp_of_negative(-z), self.force_terms(t)
        k, d = 2 * PI, self.d
        f1, b, c = k * sine / g, k**2 * cosine / g, -(k**3) * sine / g  # g'/g, g''/g and g'''/g
        f2, f3 = b - f1**2, c - 3 * f1 * b + 2 * f1**3
        first = 2 * d + f1
        return w * first, w**2 * (d * first + f2), w**3 * (2 * d**2 * first + 3 * d * f2 + f3), w**2 * g
