"""B and D, the motions P(1,1,1): equations (16.1) and (16.9) to (16.13) of docs/proofs.md.

The unknowns are s, the time from the impact on Σ⁺ to the impact on Σ⁻, Z₁ = ε sin φ and Z₂ = ε cos φ, where φ is the
phase of the forcing half-way between these impacts.
"""

from collections.abc import Callable

from .half_way import TwoImpactTerms, speeds_and_epsilon_squared, two_impact_equations
from .intervals import (
    IV,
    ONE,
    PI,
    ZERO,
    Interval,
    Jet,
    ParameterBox,
    contact_force_enclosure,
    exp_of_negative,
    is_certainly_less,
    midpoint,
    sine_and_cosine_of,
)

#: Shortest part of a flight that is bisected, in forcing periods.
SHORTEST_PART = 2.0**-13


class TwoImpactCell(ParameterBox):
    """The solutions of (16.10) and (16.11), docs/proofs.md, with s in an interval, at all δ of another interval.

    s is the time from the impact on Σ⁺ to the impact on Σ⁻.
    """

    def __init__(self, s: Interval, d: Interval, beta: Interval) -> None:
        super().__init__(s, d)
        self.known_enclosures: dict[Callable[..., list[Jet]], list[Jet]] = {}
        self.over, self.mid = TwoImpactTerms(*self.jets), TwoImpactTerms(*self.centre)
        over, centre = (two_impact_equations(terms, beta) for terms in (self.over, self.mid))
        # the equations are a Z₁ + c Z₂ = b and e Z₁ + g Z₂ = h
        a, c, b, e, g, h = (self.enclose_by_mean_value(m.x, o) for m, o in zip(centre, over, strict=True))
        # lower bounds of ε², (16.8) of docs/proofs.md
        self.square_bounds = [b**2 / (a**2 + c**2), h**2 / (e**2 + g**2)]
        self.solvable = is_certainly_less(ZERO, a * g - c * e) or is_certainly_less(a * g - c * e, ZERO)
        if self.solvable:

            def solve_for_z(first: Interval, second: Interval) -> tuple[Interval, Interval]:
                """Return the solution (Z₁, Z₂) of a Z₁ + c Z₂ = first and e Z₁ + g Z₂ = second, by Cramer's rule."""
                return (first * g - c * second) / (a * g - c * e), (a * second - e * first) / (a * g - c * e)

            z = solve_for_z(b, h)
            # the derivative of A Z = b is A Z' = b' − A' Z
            by = [[-(x * z[0] + y * z[1] - w) for x, y, w in zip(p[::3], p[1::3], p[2::3], strict=True)]
                  for p in ([o.s for o in over], [o.d for o in over])]  # fmt: skip
            by_s, by_d = solve_for_z(*by[0]), solve_for_z(*by[1])
            a, c, b, e, g, h = (m.x for m in centre)
            self.z0 = [Jet(x) for x in solve_for_z(b, h)]
            self.z = [
                Jet(self.enclose_by_mean_value(m.x, Jet(x, p, q)), p, q)
                for m, x, p, q in zip(self.z0, z, by_s, by_d, strict=True)
            ]
            self.v, self.u, self.square = self.enclose(speeds_and_epsilon_squared)
            self.middle = [each.x for each in speeds_and_epsilon_squared(self.mid, self.z0)]

    def enclose(self, functions: Callable[..., list[Jet]]) -> list[Jet]:
        """Return enclosures over the cell of the values that `functions` returns, with their derivatives by s and δ.

        `functions` takes the terms of the equations (16.10) and (16.11), docs/proofs.md, and their solution (Z₁, Z₂).

        Returns
        -------
        list[Jet]
            One enclosure for each value.
        """
        if functions not in self.known_enclosures:
            centre, over = functions(self.mid, self.z0), functions(self.over, self.z)
            self.known_enclosures[functions] = [
                Jet(self.enclose_by_mean_value(m.x, o), o.s, o.d) for m, o in zip(centre, over, strict=True)
            ]
        return self.known_enclosures[functions]

    def has_no_motion(self, low: Interval, high: Interval) -> bool:
        """Return whether it is proved that no solution of the cell has low ≤ ε² ≤ high and both speeds above 0."""
        if any(is_certainly_less(high, bound) for bound in self.square_bounds):
            return True
        if not self.solvable:
            return False
        if is_certainly_less(self.v.x, ZERO) or is_certainly_less(self.u.x, ZERO):
            return True
        if is_certainly_less(self.square.x, low) or is_certainly_less(high, self.square.x):
            return True
        return is_certainly_less(self.bound_square_plus_speed(1), low) or is_certainly_less(
            self.bound_square_plus_speed(-1), -high
        )

    def are_all_solutions_of_type(self, slope: int, low: Interval, high: Interval) -> bool | None:
        """Return whether all solutions with low ≤ ε² ≤ high are admissible motions B (slope −1) or D (slope 1).

        B are the solutions at which ε falls as s grows, D those at which ε rises; s is the time from Σ⁺ to Σ⁻.

        Returns
        -------
        bool | None
            True if all are, False if none is, None if neither is proved.
        """
        if self.has_no_motion(low, high) or (self.solvable and is_certainly_less(slope * self.square.s, ZERO)):
            return False
        if not (self.solvable and is_certainly_less(ZERO, slope * self.square.s) and is_certainly_less(ZERO, self.v.x)):
            return None
        # Only solutions with u > 0 are motions. So it must be proved that all solutions in the cell have u > 0, or that
        # those with u ≤ 0 have ε² < low or ε² > high.
        reaches = is_certainly_less(ZERO, self.u.x) or is_certainly_less(high, self.bound_square_plus_speed(1))
        if not (reaches or is_certainly_less(-low, self.bound_square_plus_speed(-1))):
            return None
        return (
            True
            if self.is_displacement_monotone(-1, ZERO, self.s) and self.is_displacement_monotone(1, self.s, ONE)
            else None
        )

    def bound_square_plus_speed(self, sign: int) -> Interval:
        """Return bounds of sign · ε² + λu over the cell, for some λ ≥ 0 that makes the bounds narrow.

        u is the speed after Σ⁻.

        Returns
        -------
        Interval
            The bounds. Lemma 17 of docs/proofs.md uses them; it holds for any λ ≥ 0.
        """
        # with this λ the derivative of the sum by s is nearly 0 (Lemma 17 of docs/proofs.md)
        factor = max(0.0, -sign * float(self.square.s.mid.a) / float(self.u.s.mid.a))
        _, u, square = self.middle
        return self.enclose_by_mean_value(sign * square + factor * u, self.square * sign + self.u * factor)

    def is_displacement_monotone(self, sign: int, start: Interval, end: Interval) -> bool:
        """Return whether Φ is proved to be monotone on a flight from time `start` to `end`, with Φ' of this sign."""
        parts = [(start.b, end.a)]
        while parts:
            low, high = parts.pop()
            first, last = low == start.b, high == end.a
            t = IV.mpf([start.a if first else low, end.b if last else high])
            push = sign * self.force_at(t)
            # sign · e^(δt) Φ' grows if push > 0, and falls if push < 0: it suffices that sign · Φ' > 0 at one end
            at, known = (
                (low, first)
                if is_certainly_less(ZERO, push)
                else (high, last)
                if is_certainly_less(push, ZERO)
                else (t, False)
            )
            if not (known or is_certainly_less(ZERO, sign * self.velocity(sign, at))):
                if is_certainly_less(high - low, SHORTEST_PART):
                    return False
                parts += [(low, midpoint(t).a), (midpoint(t).a, high)]
        return True

    def force_at(self, t: Interval) -> Interval:
        """Return the contact force g at the time t after the impact on Σ⁺."""
        sine, cosine = sine_and_cosine_of(2 * PI * t - PI * self.s)
        z1, z2 = (z.x for z in self.z)
        return contact_force_enclosure(self.d, z2 * cosine - z1 * sine, z1 * cosine + z2 * sine)

    def velocity(self, sign: int, t: Interval) -> Interval:
        """Return Φ' at a time t after the impact on Σ⁺, on the flight to Σ⁻ (sign −1) or on the flight back (1)."""
        departure, w = (ZERO, -self.v.x) if sign < 0 else (self.s, self.u.x)
        z1, z2 = (z.x for z in self.z)

        def forced_velocity(at: Interval) -> Interval:
            """Return the velocity of the particular solution 4πt + ε cos 2πt of the flight's equation."""
            sine, cosine = sine_and_cosine_of(2 * PI * at - PI * self.s)
            return 4 * PI - 2 * PI * (z1 * cosine + z2 * sine)

        return forced_velocity(t) + (w - forced_velocity(departure)) * exp_of_negative(self.d * (t - departure))
