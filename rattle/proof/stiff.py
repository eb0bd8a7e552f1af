"""A periodic motion of the stiff gear in ball arithmetic: the unknowns are the times of its contacts.

Beyond Σ± the penetration y = Φ ∓ β obeys y'' + δy' + 2κy = g(t) (1.3 of docs/proofs.md). A contact begins with y = 0
and the final velocity of the flight before it. It ends with y = 0 and the initial velocity of the flight after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from rattle.errors import NotProvedError
from rattle.proof.balls import PI, arb, arb_mat
from rattle.proof.flights import FlightEnclosure, ModelPoint, enclose_flight, require_first_impact

#: Name of this model in certificates.
MODEL = "stiff"
#: Name of the parameter that this model has besides δ, ε and β.
ADDED = "kappa"
#: Most parts of a contact's time that are examined in the proof that the contact lasts; parts that are bisected count.
MOST_PARTS = 2000


@dataclass(frozen=True)
class StiffParameters:
    """The parameters δ, ε, β and κ of the stiff gear, and quantities of its contacts that follow from them alone."""

    point: ModelPoint
    kappa: arb

    @cached_property
    def steady_amplitudes(self) -> tuple[arb, arb]:
        """The amplitudes P and Q of cos 2πt and sin 2πt in the steady motion, (1.12) and (1.13) of docs/proofs.md."""
        stiff, loss = 2 * self.kappa - 4 * PI() ** 2, 2 * PI() * self.point.delta
        a, b, size = (
            -self.point.force_amplitude,
            -self.point.delta * self.point.velocity_amplitude,
            stiff * stiff + loss * loss,
        )
        return (a * stiff - b * loss) / size, (b * stiff + a * loss) / size

    @cached_property
    def mean_steady_penetration(self) -> arb:
        """Mean penetration y in the steady motion (permanent contact): 4πδ/(2κ)."""
        return self.point.delta * self.point.drift / (2 * self.kappa)

    @cached_property
    def free_frequency(self) -> arb:
        """√(2κ − δ²/4), the frequency of free oscillations of a contact. Raises NotProvedError if overdamped."""
        square = 2 * self.kappa - self.point.delta**2 / 4
        if not square > 0:
            raise NotProvedError(
                "contacts are overdamped, for which this program has no proof: kappa must exceed delta²/8"
            )
        return square.sqrt()

    def steady_motion(self, t: arb) -> tuple[arb, arb]:
        """Return the penetration y and its derivative y' at time t in permanent contact, (1.11) of docs/proofs.md."""
        (a, b), (sine, cosine) = self.steady_amplitudes, (2 * t).sin_cos_pi()
        return self.mean_steady_penetration + a * cosine + b * sine, 2 * PI() * (b * cosine - a * sine)

    def tangent(self, u: arb) -> tuple[arb, arb, arb, arb]:
        """Return the tangent map (C, S, −2κS, C − δS) of (y, y') over a time u in contact: (1.15) of docs/proofs.md."""
        delta = self.point.delta
        sine, cosine = (self.free_frequency * u).sin_cos()
        kept = (-delta * u / 2).exp()
        s = kept * sine / self.free_frequency
        c = kept * cosine + delta * s / 2
        return c, s, -2 * self.kappa * s, c - delta * s

    def force(self, time: arb) -> arb:
        """Return the contact force g at a time."""
        return self.point.force(*(2 * time).sin_cos_pi())


@dataclass(frozen=True)
class ContactEnclosure:
    """A contact that begins at time t0 with penetration y = 0 and the velocity w, and ends at time t1."""

    parameters: StiffParameters
    t0: arb
    t1: arb
    w: arb

    @cached_property
    def initial_deviation(self) -> tuple[arb, arb]:
        """The state (y, y') at t0 minus that of the steady motion (permanent contact); y is the penetration."""
        y, v = self.parameters.steady_motion(self.t0)
        return -y, self.w - v

    @cached_property
    def tangent(self) -> tuple[arb, arb, arb, arb]:
        """The tangent map (C, S, −2κS, C − δS) of (y, y') from t0 to t1, the ends of the contact."""
        return self.parameters.tangent(self.t1 - self.t0)

    @cached_property
    def final_state(self) -> tuple[arb, arb]:
        """The state (y, y') at t1, where y is the penetration of the wall."""
        return self._state_from_tangent(self.t1, self.tangent)

    def state_at(self, t: arb) -> tuple[arb, arb]:
        """Return the penetration y of the wall, and y', at time t."""
        return self._state_from_tangent(t, self.parameters.tangent(t - self.t0))

    def _state_from_tangent(self, t: arb, tangent: tuple[arb, arb, arb, arb]) -> tuple[arb, arb]:
        """Return the penetration y, and y', at time t, from the tangent map between t0 and t."""
        (moved, pushed), (y, v), (c, s, c1, s1) = self.initial_deviation, self.parameters.steady_motion(t), tangent
        return y + c * moved + s * pushed, v + c1 * moved + s1 * pushed


@dataclass(frozen=True)
class StiffEnclosures:
    """The contacts (c,) and flights (c,) of a motion between given times; flight i follows contact i.

    The unknowns (2c,) are the times at which each contact begins and ends.
    """

    parameters: StiffParameters
    itinerary: tuple[int, ...]
    contacts: list[ContactEnclosure]
    flights: list[FlightEnclosure]

    @property
    def residual(self) -> list[arb]:
        """R (2c,): penetration y at the end of each contact, and y' there minus the next flight's initial velocity."""
        pairs = zip(self.contacts, self.flights, strict=True)
        return [
            each for contact, after in pairs for each in (contact.final_state[0], contact.final_state[1] - after.w0)
        ]

    @property
    def jacobian(self) -> arb_mat:
        """The Jacobian ∂R/∂t (2c, 2c) of the residual R with respect to the times of the contacts."""
        n, delta = 2 * len(self.itinerary), self.parameters.point.delta
        matrix = [[arb(0)] * n for _ in range(n)]
        for i, (contact, after) in enumerate(zip(self.contacts, self.flights, strict=True)):
            before, begin, end = self.flights[i - 1], 2 * i, 2 * i + 1
            (c, s, c1, s1), (y, v) = contact.tangent, contact.final_state
            pull = self.parameters.force(contact.t0) - delta * contact.w
            push = self.parameters.force(contact.t1) - delta * v - 2 * self.parameters.kappa * y
            for row, by_y, by_v, by_end in ((begin, c, s, v), (end, c1, s1, push)):
                matrix[row][begin - 1] += by_v * before.w1_t0
                matrix[row][begin] += by_v * before.w1_t1 - by_y * contact.w - by_v * pull
                matrix[row][end] += by_end
            matrix[end][end] -= after.w0_t0
            matrix[end][(end + 1) % n] -= after.w0_t1
        return arb_mat(matrix)

    @property
    def speeds(self) -> list[arb]:
        """The speeds (2c,) at the beginning and the end of each contact."""
        each = zip(self.itinerary, self.contacts, self.flights, strict=True)
        return [speed for wall, contact, after in each for speed in (wall * contact.w, -wall * after.w0)]

    @property
    def trace(self) -> arb:
        """The trace of the product of the tangent maps of (Φ, Φ') over all contacts and flights."""
        product, delta = arb_mat([[1, 0], [0, 1]]), self.parameters.point.delta
        for contact, after in zip(self.contacts, self.flights, strict=True):
            c, s, c1, s1 = contact.tangent
            product = (
                arb_mat([[1, (1 - after.decay) / delta], [0, after.decay]]) * arb_mat([[c, s], [c1, s1]]) * product
            )
        return product.trace()

    def require_admissible(self) -> None:
        """Raise NotProvedError unless every contact and every flight is proved not to end before its stated time."""
        for i, (contact, after) in enumerate(zip(self.contacts, self.flights, strict=True)):
            wall, target = self.itinerary[i], self.itinerary[(i + 1) % len(self.itinerary)]
            require_contact_lasts(contact, wall, f"contact {i + 1}")
            require_first_impact(after, wall, target, f"the flight after contact {i + 1}")


@dataclass(frozen=True)
class StiffSystem:
    """The equations of a motion with given contacts: c contacts with the walls `itinerary` in m forcing periods.

    The unknowns (2c,) are the times at which the contacts begin and end, in turn.
    """

    parameters: StiffParameters
    itinerary: tuple[int, ...]
    m: int

    def __call__(self, times: Sequence[arb]) -> StiffEnclosures:
        """Return the contacts and flights with these times (2c,); they form a motion if their residual R is 0."""
        c, n, point = len(self.itinerary), len(times), self.parameters.point
        turns = [(2 * time).sin_cos_pi() for time in times]
        flights = [
            enclose_flight(
                point, times[i], times[i + 1] if i + 1 < n else times[0] + self.m, turns[i], turns[(i + 1) % n],
                point.beta * (self.itinerary[(i // 2 + 1) % c] - self.itinerary[i // 2]),
            )
            for i in range(1, n, 2)
        ]  # fmt: skip
        contacts = [
            ContactEnclosure(self.parameters, times[2 * i], times[2 * i + 1], flights[i - 1].w1) for i in range(c)
        ]
        return StiffEnclosures(self.parameters, self.itinerary, contacts, flights)


def require_contact_lasts(contact: ContactEnclosure, wall: int, name: str) -> None:
    """Prove that wall · y > 0 between the beginning and the end of a contact (Lemma 6 of docs/proofs.md).

    y = Φ ∓ β is the penetration of Σ±, and `wall` is 1 for Σ⁺ and −1 for Σ⁻.

    The time of the contact is bisected. At both ends of each part wall · y > 0 is proved, or y = 0 because the contact
    begins or ends there. So wall · y > 0 within the part if y' has one sign there; if not, the mean value theorem
    bounds y.

    Raises
    ------
    NotProvedError
        If the proof fails; the contact may end earlier.
    """
    if not contact.t1 > contact.t0:
        raise NotProvedError(
            f"the duration of {name} is not proved to be positive: its times are wrong, or enclosed too widely"
        )
    if not wall * contact.w > 0:
        raise NotProvedError(f"{name} is not proved to begin with a velocity into its wall: it may graze")
    parts = [(contact.t0.lower(), contact.t1.upper())]
    for _ in range(MOST_PARTS):
        start, end = parts.pop()
        part = start.union(end)
        middle, slope = part.mid(), contact.state_at(part)[1]
        if not (slope > 0 or slope < 0):
            y = wall * contact.state_at(middle)[0]
            if not y > 0:
                break
            if not y + wall * slope * (part - middle) > 0:
                parts += [(start, middle), (middle, end)]
        if not parts:
            return
    raise NotProvedError(f"{name} may end before its stated time")
