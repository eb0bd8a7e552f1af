"""The proof that an impact is the first of its flight: the flight touches no wall before (compiled).

The arc is the interval of phases in which the contact force is negative
(`rattle.flight.forcing.find_negative_force_arc`), if there is one. The next arc is the first one that ends after the
departure.
"""

from numpy import float32 as f32
from numpy import floor

from rattle.flight.forcing import (
    NegativeArc,
    add_slope_change32,
    largest_acceleration32,
    largest_slope_loss32,
    sine_changes_to_arc32,
)
from rattle.flight.guess import EQUAL_WITHIN, ERROR, LONGEST_DECAY32, sum_of_height_term_sizes, sum_of_slope_term_sizes
from rattle.flight.law import decay_remainder32, evaluate32
from rattle.numerics.compile import inline

LATER_FACTOR = f32(1.0002)  # bound of a flight's duration in double precision over that in single precision
# longest step of `refine_time_at_level` to the impact, as a share of the flight time: `final_step_to_impact` can remove
# the error of such a step. After a longer step it is cheaper to locate the impact again.
LARGEST_STEP = f32(0.05)
# The last step is made from a time s only if the sum of the sizes of the terms of F is below this number times s |F'|.
# Above it, as in a graze or a long flight, rounding of F would cost the thirteenth digit of the time of the impact.
STEEPEST = f32(100.0)
# above this damping, rounding of the times to the ends of the arc of negative contact force may change F' by more than
# ERROR allows (`is_departure_side_certain`)
FASTEST = f32(20.0)


@inline
def is_one_final_step_enough(s, step, speed, flight):
    """Return whether one step takes an impact time s from single to double precision.

    One step suffices if the step that led to s was short, δs is within the range of the polynomials, and F' at s
    (`speed`) is large enough: in a graze or a long flight, rounding of F would cost digits of s.

    Returns
    -------
    bool
        False means that the impact has to be located anew, by a scan or a safe search.
    """
    near = (abs(step) < LARGEST_STEP * s) & (flight.delta * s < LONGEST_DECAY32)
    return near & (sum_of_height_term_sizes(s, flight) < STEEPEST * s * abs(speed))


@inline
def convert_arc_to_single_precision(arc):
    """Return an arc of negative contact force, converted to single precision."""
    return NegativeArc(arc.exists, f32(arc.exit_phase), f32(arc.length), f32(arc.sin_entry), f32(arc.sin_exit))


@inline
def times_to_arc(tau, arc):
    """Return the times until the next arc of negative contact force begins and ends, and whether tau lies inside it.

    Returns
    -------
    tuple[float, float, bool]
        The time to the beginning, 0 if tau is inside; the time to the end; True if tau is inside.
    """
    to_exit = arc.exit_phase - tau
    to_exit -= floor(to_exit)
    inside = to_exit < arc.length
    return f32(0.0) if inside else to_exit - arc.length, to_exit, inside


@inline
def is_departure_side_certain(to_exit, arc_length, delta):
    """Return whether rounding cannot move the departure of a flight into or out of the arc of negative contact force.

    Rounding cannot do so if the departure is far from both ends of the arc. The damping must also be so small that a
    rounding of 1e-7 of the times to the ends changes F' by less than ERROR allows.

    Returns
    -------
    bool
        False if the departure may be inside or outside.
    """
    return (
        (delta < FASTEST)
        & (to_exit > EQUAL_WITHIN)
        & (to_exit < f32(1.0) - EQUAL_WITHIN)
        & (abs(to_exit - arc_length) > EQUAL_WITHIN)
    )


@inline
def has_at_most_one_turn(wall, rising, tau, s, turn, flight, arc):
    """Return whether F' certainly changes sign at most once before s, given the sign of F' at s.

    rising: whether F' > 0 at s. turn: the estimated time of the change of sign. The result is True only if it is also
    certain that e^(δs) F' grows between the true and the estimated time of this change.

    e^(δs) F' grows where the contact force is positive, and falls on the arc, where the force is negative. Therefore F'
    changes sign at most once before the arc, once on the arc and once after it. The signs of F' at both ends of the arc
    show which of these changes are possible. (F' is cheap at these ends, because their sines are known.)

    Returns
    -------
    bool
        False means that it is not certain.
    """
    w, a, sin0, _cos0, delta, epsilon = flight
    to_entry, to_exit, inside = times_to_arc(tau, arc)
    x, y = delta * to_entry, delta * to_exit
    slack = ERROR * sum_of_slope_term_sizes(flight)
    dsin_entry, dsin_exit = sine_changes_to_arc32(inside, sin0, arc)
    at_entry = add_slope_change32(w + a * x * (f32(1.0) - x * decay_remainder32(x)), dsin_entry, epsilon)
    at_exit = add_slope_change32(w + a * y * (f32(1.0) - y * decay_remainder32(y)), dsin_exit, epsilon)
    falls_in = (at_entry < -slack) | (inside & (w < f32(0.0)))
    rises_out = at_exit > slack
    end = s * LATER_FACTOR + EQUAL_WITHIN
    from_top = wall > f32(0.0)
    next_entry = to_exit + f32(1.0) - arc.length
    before = (turn < to_entry - EQUAL_WITHIN) | (not from_top)
    after = (turn > to_exit + EQUAL_WITHIN) & (turn < next_entry - EQUAL_WITHIN) & from_top
    up = before & ((end < to_exit) | (rises_out & (end < to_exit + f32(1.0))))
    up |= after & falls_in & (end < to_exit + f32(1.0))
    down = (end < to_entry) | (falls_in & (end < next_entry))
    safe = is_departure_side_certain(to_exit, arc.length, delta) & (y < LONGEST_DECAY32)
    return (not arc.exists) | (safe & ((up & rising) | (down & (not rising))))


@inline
def height_lower_bound(s, minimum, delta):
    """Return a lower bound of a flight's height F on [0, s].

    The bound holds if e^(δs) F' grows between the true minimum of F and the estimated one.

    `minimum` is the estimated minimum, with a lower bound of F and an upper bound of |F'| (`tilt`) at this point.
    Between the true and the estimated minimum |F'| is at most e^(δs) tilt.

    Returns
    -------
    float
        The bound, in the unit of F.
    """
    x = delta * s
    # an upper bound of k e^(kx) for x = δs < 2; k = LATER_FACTOR, as the flight may end later in double precision
    growth = LATER_FACTOR + x * (f32(1.0006) + f32(1.101) * x)
    return minimum.bound - minimum.tilt * s * growth


@inline
def is_certain_to_miss_opposite_wall(wall, rising, s, minimum, gap, flight):
    """Return whether a flight from Σ⁺ back to Σ⁺ certainly clears Σ⁻, because it is too short or turns above Σ⁻.

    The flight is too short if it could not cross the gap at its highest speed. While Φ falls, |F'| stays below
    |w| + max (e'(t₀) − e') if A of the flight law is positive; for one cosine this is |w| + 2πε (1 − sin θ).

    Returns
    -------
    bool
        False if it is not certain. True for flights that leave or reach Σ⁻, for which there is nothing to check.
    """
    fastest = abs(flight.w) + largest_slope_loss32(flight.sin0, flight.cos0, flight.epsilon)
    shallow = fastest * s * LATER_FACTOR < f32(0.9999) * gap
    turns_above = (height_lower_bound(s, minimum, flight.delta) > -gap) & (minimum.time < s)
    return ((shallow & (flight.a > f32(0.0))) | turns_above) | ((wall < f32(0.0)) | (not rising))


@inline
def is_certain_to_miss_wall_at_both_minima(wall, rising, tau, s, minimum, gap, flight, arc):
    """Return whether a flight from Σ⁺ to Σ⁺ certainly has two minima of its height F, and no impact before its end.

    The minima are before and after the arc of negative contact force, and between them F has a maximum on the arc.

    On a piece where e^(δs) F' is monotone, its values at both ends bound F' on the piece. Therefore F lies on one side
    of two lines: each goes through the value of F at one end and has one of these bounds as its slope. The crossing of
    the lines bounds the extremum of F.

    Returns
    -------
    bool
        False means that it is not certain.
    """
    w, delta = flight.w, flight.delta
    to_entry, to_exit, inside = times_to_arc(tau, arc)
    f_entry, g_entry, _f2, lost_entry, _s, _c = evaluate32(to_entry, flight)
    f_exit, g_exit, _f2, lost_exit, _s, _c = evaluate32(to_exit, flight)
    _f, g_end, _f2, lost_end, _s, _c = evaluate32(s, flight)
    slack, low = ERROR * sum_of_slope_term_sizes(flight), f32(4.0) * ERROR * sum_of_height_term_sizes(s, flight)
    turned = (g_entry > slack) & (g_exit < -slack) & (not inside)
    up, down = g_entry + slack, g_exit - slack
    decay_entry, decay_exit, decay_end = f32(1.0) - lost_entry, f32(1.0) - lost_exit, f32(1.0) - lost_end
    steep = up / decay_entry  # F' lies between w and steep before the arc
    first = w * (steep * to_entry - f_entry) / (steep - w)
    steep = -down * decay_entry / decay_exit  # F' lies between −steep and up on the arc
    top = f_entry + up * (f_exit - f_entry + steep * arc.length) / (up + steep)
    # an upper bound of |F''|: double precision may move the end by 1e-4 forcing periods, which changes F' at the end by
    # at most 1e-4 |F''|
    bend = delta * abs(flight.a) + largest_acceleration32(flight.epsilon)
    # F' lies between down and steep after the arc
    steep = (g_end + slack + f32(1e-4) * bend) * decay_exit / decay_end
    early, late = s * (f32(2.0) - LATER_FACTOR) - EQUAL_WITHIN, s * LATER_FACTOR + EQUAL_WITHIN
    second = f_exit + down * (f_exit + steep * (late - to_exit)) / (steep - down)
    behind = (minimum.time > to_exit + EQUAL_WITHIN) & (minimum.time < s)
    second = max(second, height_lower_bound(s, minimum, delta)) if behind else second
    clear = (top < -low) & (first > low - gap) & (second > low - gap)
    placed = (
        (early > to_exit)
        & (late < to_exit + f32(1.0) - arc.length)
        & is_departure_side_certain(to_exit, arc.length, delta)
    )
    from_top = (wall > f32(0.0)) & rising & arc.exists
    return from_top & turned & clear & placed & (delta * s < LONGEST_DECAY32)
