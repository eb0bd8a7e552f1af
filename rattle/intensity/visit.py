"""Follow a motion from impact to impact on either wall, and list or sum its impacts (compiled).

The type of the parameter point selects the gear's `follow_to_next_departure`. For the stiff gear an impact is a
contact. For the inelastic gear a contact phase counts as the duration of the impact with which it begins.
"""

from typing import Any, NamedTuple

from rattle.flight.first_impact import OK, SIGMA_PLUS
from rattle.flight.law import fold_phase
from rattle.numerics.compile import inline, kernel

# columns of the sums of `sum_impacts`: time, impacts on each wall, Σv, Σv², time in contact, impulse, largest v
COLUMNS = 8
TIME, ON_PLUS, ON_MINUS, SPEED, SQUARE, CONTACT, IMPULSE, FASTEST = range(COLUMNS)


class Impacts(NamedTuple):
    """Impacts in order, arrays (n,).

    Attributes
    ----------
    time
        When each impact begins, in forcing periods; whole numbers are at phase 0.
    wall
        +1 (Φ = β) or −1 (Φ = −β).
    speed, departure
        Speed of arrival and of departure.
    duration
        Duration of the contact, in forcing periods.
    impulse
        Change of Φ' that the impact causes, positive away from the wall.

    Notes
    -----
    In the impacting model departure equals speed, duration is 0 and impulse is twice the speed. With restitution r,
    departure is r times the speed. In a chatter that ends in contact, the infinitely many weakest impacts are listed as
    one impact, with departure 0, the duration of the contact phase, and an impulse that includes the force in contact.
    """

    time: Any
    wall: Any
    speed: Any
    departure: Any
    duration: Any
    impulse: Any


def follow_to_next_departure(wall, tau, w, point):
    """Follow a flight from a wall to its impact, and return the flight time, the impact and the next departure.

    wall, tau, w: the wall that the flight leaves, and the phase and the velocity of this departure.

    Returns
    -------
    tuple
        (status, time of flight, wall, speed of arrival, duration of the contact, impulse, speed of departure).

    Raises
    ------
    NotImplementedError
        If the function is called outside kernels.
    """
    raise NotImplementedError("bounce exists inside kernels only: from Python use Gear.impacts")


def mean_contact_force_at_point(point):
    """Return the mean contact force at a parameter point, which the impulses of every bounded motion balance."""
    raise NotImplementedError("mean_contact_force_at_point exists inside kernels only: from Python use Gear.intensity")


@inline
def add_impact_to_sums(row, s, wall, speed, duration, impulse):
    """Add an impact to a row of sums. s: time of flight before the impact. duration: time of contact at the impact."""
    row[TIME] += s + duration
    row[ON_PLUS if wall > 0 else ON_MINUS] += 1.0
    row[SPEED] += speed
    row[SQUARE] += speed * speed
    row[CONTACT] += duration
    row[IMPULSE] += wall * impulse
    row[FASTEST] = max(row[FASTEST], speed)


@kernel
def sum_impacts(tau, v, returns, periods, most, point, sums):
    """Follow the motion that leaves Σ⁺ at (τ, v) until it reaches one of three limits, and sum its impacts.

    The limits are `returns` further departures from Σ⁺, `periods` forcing periods, and `most` impacts. `sums` is an
    array (batches, COLUMNS) of zeros. The `periods` forcing periods are divided into as many equal parts as `sums` has
    rows, and row j receives the impacts whose flight begins in part j. The last column is the largest speed, not a sum.

    Returns
    -------
    tuple
        (status, τ', v', time) at the end.
    """
    wall, w, now, back, batches = SIGMA_PLUS, -v, 0.0, 0, sums.shape[0]
    for _ in range(most):
        status, s, wall, speed, duration, impulse, departure = follow_to_next_departure(wall, tau, w, point)
        if status != OK:
            return status, tau, abs(w), now
        add_impact_to_sums(sums[min(int(now / periods * batches), batches - 1)], s, wall, speed, duration, impulse)
        tau, w, now = fold_phase(tau + s + duration), -wall * departure, now + s + duration
        back += wall > 0
        if back >= returns or now >= periods:
            break
    return OK, tau, abs(w), now


@kernel
def write_impacts_of_motion(tau, v, returns, periods, point, impacts):
    """Follow the motion that leaves Σ⁺ at (τ, v), and write its impacts one by one to the arrays of `impacts`.

    The motion is followed for `returns` further departures from Σ⁺ or `periods` forcing periods, whichever ends first,
    as long as the arrays have room.

    Returns
    -------
    tuple
        (status, τ', v', number of impacts); the number is one more than the arrays hold if the motion goes on beyond
        them.
    """
    wall, w, start, now, back = SIGMA_PLUS, -v, tau, 0.0, 0
    for i in range(impacts.time.size):
        status, s, wall, speed, duration, impulse, departure = follow_to_next_departure(wall, tau, w, point)
        if status != OK:
            return status, tau, abs(w), i
        impacts.time[i], impacts.wall[i], impacts.speed[i] = start + now + s, wall, speed
        impacts.departure[i], impacts.duration[i], impacts.impulse[i] = departure, duration, impulse
        tau, w, now = fold_phase(tau + s + duration), -wall * departure, now + s + duration
        back += wall > 0
        if back >= returns or now >= periods:
            return OK, tau, abs(w), i + 1
    return OK, tau, abs(w), impacts.time.size + 1
