"""The proof that a root of a flight is its first impact: nothing of the flight before it touches a wall (compiled)."""

from numpy import float32 as f32
from numpy import floor

from rattle.flight.forcing import (
    Arc,
    largest_acceleration32,
    largest_slope_loss32,
    plus_slope_change32,
    sine_changes_to_arc32,
)
from rattle.flight.guess import CLOSE, ERROR, TOO_FAR, height_scale, speed_scale
from rattle.flight.law import decay32, evaluate32
from rattle.numerics.compile import inline

LATER = f32(1.0002)  # double precision may end a flight up to 1e-4 of it later than single precision
LARGEST_STEP = f32(0.05)  # a longer step of fourth order leaves too much for `last_step`: a second attempt is cheaper
STEEPEST = f32(100.0)  # terms of F this much larger than s |F'| at the impact would spoil the time's thirteenth digit
FASTEST = f32(20.0)  # largest damping of a proof that uses the times of the arc


@inline
def is_located(s, step, speed, flight):
    """Return whether double precision may end what single precision began: a short step, and an impact but no graze."""
    near = (abs(step) < LARGEST_STEP * s) & (flight.delta * s < TOO_FAR)
    return near & (height_scale(s, flight) < STEEPEST * s * abs(speed))


@inline
def arc_in_single(arc):
    """Return an arc in single precision."""
    return Arc(arc.exists, f32(arc.leave), f32(arc.length), f32(arc.sin_entry), f32(arc.sin_exit))


@inline
def arc_ahead(tau, arc):
    """Return the times to the entry (0 inside) and to the exit of the next arc, and whether the departure is inside."""
    to_exit = arc.leave - tau
    to_exit -= floor(to_exit)
    inside = to_exit < arc.length
    return f32(0.0) if inside else to_exit - arc.length, to_exit, inside


@inline
def off_edges(to_exit, arc_length, delta):
    """Return whether rounding cannot confuse the side of the arc that the departure is on.

    The departure is far from the ends of the arc then, and the damping so small that rounding of these times, 1e-7,
    moves F' by less than ERROR allows.

    Returns
    -------
    bool
        False means that the side is not certain.
    """
    return (delta < FASTEST) & (to_exit > CLOSE) & (to_exit < f32(1.0) - CLOSE) & (abs(to_exit - arc_length) > CLOSE)


@inline
def single_turn(wall, rising, tau, s, turn, flight, arc):
    """Return whether F' certainly changes sign at most once before s, given its sign at s.

    Also e^(δs) F' must grow between that change and the place where it seemed to be. It grows where the contact force g
    is positive and falls on the phase arc where g < 0, if there is one. So its sign where the arc is entered and left,
    which needs no new sine, settles its signs everywhere else.

    Returns
    -------
    bool
        False means that it is not certain.
    """
    w, a, sin0, _cos0, delta, epsilon = flight
    to_entry, to_exit, inside = arc_ahead(tau, arc)
    x, y = delta * to_entry, delta * to_exit
    slack = ERROR * speed_scale(flight)
    dsin_entry, dsin_exit = sine_changes_to_arc32(inside, sin0, arc)
    at_entry = plus_slope_change32(w + a * x * (f32(1.0) - x * decay32(x)), dsin_entry, epsilon)
    at_exit = plus_slope_change32(w + a * y * (f32(1.0) - y * decay32(y)), dsin_exit, epsilon)
    falls_in = (at_entry < -slack) | (inside & (w < f32(0.0)))
    rises_out = at_exit > slack
    end = s * LATER + CLOSE
    from_top = wall > f32(0.0)
    next_entry = to_exit + f32(1.0) - arc.length
    before = (turn < to_entry - CLOSE) | (not from_top)
    after = (turn > to_exit + CLOSE) & (turn < next_entry - CLOSE) & from_top
    up = before & ((end < to_exit) | (rises_out & (end < to_exit + f32(1.0))))
    up |= after & falls_in & (end < to_exit + f32(1.0))
    down = (end < to_entry) | (falls_in & (end < next_entry))
    safe = off_edges(to_exit, arc.length, delta) & (y < TOO_FAR)
    return (not arc.exists) | (safe & ((up & rising) | (down & (not rising))))


@inline
def lowest_point(s, minimum, delta):
    """Return a lower bound of F up to s, if e^(δs) F' grows between the minimum and the point near it.

    There |F'| is at most e^(δs) tilt.

    Returns
    -------
    float
        The bound, in the unit of F.
    """
    x = delta * s
    growth = LATER + x * (f32(1.0006) + f32(1.101) * x)  # over LATER e^(LATER x), for x < 2
    return minimum.bound - minimum.tilt * s * growth


@inline
def clears_the_gap(wall, rising, s, minimum, gap, flight):
    """Return whether a flight from Σ⁺ back to Σ⁺ certainly clears Σ⁻: it is too short for that, or turns above.

    Falling, |F'| stays below v + max (e'(t₀) − e') where a ≥ 0, which for one cosine is v + 2πε (1 − sin θ).

    Returns
    -------
    bool
        False means that it is not certain.
    """
    fastest = abs(flight.w) + largest_slope_loss32(flight.sin0, flight.cos0, flight.epsilon)
    shallow = fastest * s * LATER < f32(0.9999) * gap
    turns_above = (lowest_point(s, minimum, flight.delta) > -gap) & (minimum.time < s)
    return ((shallow & (flight.a > f32(0.0))) | turns_above) | ((wall < f32(0.0)) | (not rising))


@inline
def two_turns(wall, rising, tau, s, minimum, gap, flight, arc):
    """Return whether a flight from Σ⁺ back to Σ⁺ certainly turns before the arc, on it and after it.

    It must also touch neither wall before s. Where e^(δs) F' is monotone, its values at the ends bound F' between them,
    so F lies above or below the lines of these slopes through its own values at the ends: the two lines' crossing
    bounds the extremum.

    Returns
    -------
    bool
        False means that it is not certain.
    """
    w, delta = flight.w, flight.delta
    to_entry, to_exit, inside = arc_ahead(tau, arc)
    f_entry, g_entry, _f2, lost_entry, _s, _c = evaluate32(to_entry, flight)
    f_exit, g_exit, _f2, lost_exit, _s, _c = evaluate32(to_exit, flight)
    _f, g_end, _f2, lost_end, _s, _c = evaluate32(s, flight)
    slack, low = ERROR * speed_scale(flight), f32(4.0) * ERROR * height_scale(s, flight)
    turned = (g_entry > slack) & (g_exit < -slack) & (not inside)
    up, down = g_entry + slack, g_exit - slack
    decay_entry, decay_exit, decay_end = f32(1.0) - lost_entry, f32(1.0) - lost_exit, f32(1.0) - lost_end
    steep = up / decay_entry  # F' between departure and entry is at most this, and at least w
    first = w * (steep * to_entry - f_entry) / (steep - w)
    steep = -down * decay_entry / decay_exit  # on the arc F' is between −steep and up
    top = f_entry + up * (f_exit - f_entry + steep * arc.length) / (up + steep)
    bend = delta * abs(flight.a) + largest_acceleration32(
        flight.epsilon
    )  # at least |F''|: double precision may move the end by 1e-4
    steep = (g_end + slack + f32(1e-4) * bend) * decay_exit / decay_end  # after it F' is between down and steep
    early, late = s * (f32(2.0) - LATER) - CLOSE, s * LATER + CLOSE
    second = f_exit + down * (f_exit + steep * (late - to_exit)) / (steep - down)
    behind = (minimum.time > to_exit + CLOSE) & (minimum.time < s)
    second = max(second, lowest_point(s, minimum, delta)) if behind else second
    clear = (top < -low) & (first > low - gap) & (second > low - gap)
    placed = (early > to_exit) & (late < to_exit + f32(1.0) - arc.length) & off_edges(to_exit, arc.length, delta)
    from_top = (wall > f32(0.0)) & rising & arc.exists
    return from_top & turned & clear & placed & (delta * s < TOO_FAR)
