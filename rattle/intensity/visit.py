"""A motion from impact to impact on either wall: a list of them, and what they sum up to (compiled).

The type of the point says which gear is meant: `bounce` is that of its kind. An impact of the stiff gear is a contact,
which a flight begins. A contact phase of the inelastic gear is the duration of the impact before it.
"""

from typing import Any, NamedTuple

from rattle.flight.first_impact import OK, SIGMA_PLUS
from rattle.flight.law import folded
from rattle.numerics.compile import inline, kernel

COLUMNS = 8  # of sums: what `summed` gathers
TIME, ON_PLUS, ON_MINUS, SPEED, SQUARE, CONTACT, IMPULSE, FASTEST = range(COLUMNS)


class Impacts(NamedTuple):
    """Impacts in their order, arrays (n,).

    time: when each begins, in forcing periods, whole ones at phase 0; wall: +1 (Φ = β) or −1; speed and departure: of
    arrival and of departure; duration: of the contact, in forcing periods; impulse: by how much it turns Φ' away from
    the wall. In the impacting model departure is speed, duration 0 and impulse twice the speed; with restitution r
    departure is r times the speed. Of a chatter that ends in contact the impacts above rounding are listed; the last
    of them has departure 0, the contact phase for its duration, and an impulse that includes the force in contact.
    """

    time: Any
    wall: Any
    speed: Any
    departure: Any
    duration: Any
    impulse: Any


def bounce(wall, tau, w, point):
    """Return the flight and the contact from a departure with velocity w to the next one.

    They are (status, time of flight, wall, speed of arrival, duration of the contact, impulse, speed of departure).
    """
    raise NotImplementedError("for kernels only")


def mean_force_at(point):
    """Return the mean contact force of a point, which the impulses of a lasting motion balance in every period."""
    raise NotImplementedError("for kernels only")


@inline
def add_impact(row, s, wall, speed, duration, impulse):
    """Enter one impact into a row of sums."""
    row[TIME] += s + duration
    row[ON_PLUS if wall > 0 else ON_MINUS] += 1.0
    row[SPEED] += speed
    row[SQUARE] += speed * speed
    row[CONTACT] += duration
    row[IMPULSE] += wall * impulse
    row[FASTEST] = max(row[FASTEST], speed)


@kernel
def summed(tau, v, returns, periods, most, point, sums):
    """Follow the motion that leaves Σ⁺ at (τ, v), until one of three limits is met.

    Either it has left Σ⁺ `returns` times more, or `periods` forcing periods have passed, or it made `most` impacts.
    Sums (batches, COLUMNS), zero before, are what the impacts add up to in equal parts of the periods; the last column
    has the largest speed.

    Returns
    -------
    tuple
        (status, τ', v', time) at the end.
    """
    wall, w, now, back, batches = SIGMA_PLUS, -v, 0.0, 0, sums.shape[0]
    for _ in range(most):
        status, s, wall, speed, duration, impulse, departure = bounce(wall, tau, w, point)
        if status != OK:
            return status, tau, abs(w), now
        add_impact(sums[min(int(now / periods * batches), batches - 1)], s, wall, speed, duration, impulse)
        tau, w, now = folded(tau + s + duration), -wall * departure, now + s + duration
        back += wall > 0
        if back >= returns or now >= periods:
            break
    return OK, tau, abs(w), now


@kernel
def list_impacts(tau, v, returns, periods, point, impacts):
    """Do `summed` with the impacts written one by one, as far as there is room: (status, τ', v', their number)."""
    wall, w, start, now, back = SIGMA_PLUS, -v, tau, 0.0, 0
    for i in range(impacts.time.size):
        status, s, wall, speed, duration, impulse, departure = bounce(wall, tau, w, point)
        if status != OK:
            return status, tau, abs(w), i
        impacts.time[i], impacts.wall[i], impacts.speed[i] = start + now + s, wall, speed
        impacts.departure[i], impacts.duration[i], impacts.impulse[i] = departure, duration, impulse
        tau, w, now = folded(tau + s + duration), -wall * departure, now + s + duration
        back += wall > 0
        if back >= returns or now >= periods:
            return OK, tau, abs(w), i + 1
    return OK, tau, abs(w), impacts.time.size + 1
