"""Find the eccentricities between which each motion of a point attracts. Other processes run these functions.

A periodic motion is followed along its branch to the event at each end, which is exact. Chaos, and the periodic motions
of a model without branches, are followed in steps of ε instead: each end is then a bracket.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

import rattle
from gear_rattle.service.explorer.common.address import Pair
from rattle import PeriodicOrbit, RattleError
from rattle.models import AnyGear, Capability, model_of_gear
from rattle.plot import legend_name
from rattle.stiff import StiffOrbit, stiff_branch

# most attractors of a point that are followed; most impacts of a periodic motion that is followed along its branch
MOST_FOLLOWED, MOST_IMPACTS = 12, 64
STEPS = 150  # steps of a sweep over the whole range of ε
# A sweep of a chaotic attractor follows STATES states of one trajectory. Each state is RETURNS iterates of the return
# map after the state before.
STATES, RETURNS = 16, 37
WINDOW_STEPS = 4  # a sweep of chaos continues beyond periodic windows that are at most this many steps wide
# A sweep halves a step that loses the attractor. It stops halving in two cases: the step is at most SMALLEST_STEP of a
# full step; or it is at most FINEST_STEP of a full step and at most NEAR_SHARE of the distance in ε from the gear.
FINEST_STEP, NEAR_SHARE, SMALLEST_STEP = 1 / 32, 1 / 8, 1e-9

#: Values of `ExtentEnd.kind`: first the events of a branch, with the names that `rattle` has for them; then the others.
SADDLE_NODE, FLIP, GRAZING = "SN", "PD", "GR"
CRISIS, QUIET_LIMIT, SWEPT, RANGE, LOST = "crisis", "quiet limit", "swept", "range", "lost"


class ExtentEnd(NamedTuple):
    """One end of the range of ε in which a motion attracts.

    kind: SN, PD or GR for an event of the branch; "crisis" for a boundary crisis; "quiet limit" for the end of quiet
    running; "swept" if a sweep only bracketed the end; "range" if the motion attracts up to the end of the range that
    was searched; "lost" if the motion could not be followed farther. error: half the width of the bracket, 0 if the end
    is exact. curve: the curve of the (δ, ε) plane on which the event lies, or "". motion_beyond: the name of the motion
    on the far side of the end, which the sweep reached or the event leads to; "" if unknown. remains: True for a period
    doubling on whose far side the motion still exists, but does not attract.
    """

    kind: str
    epsilon: float
    error: float = 0.0
    curve: str = ""
    motion_beyond: str = ""
    remains: bool = False


class MotionExtent(NamedTuple):
    """The range of ε in which a motion attracts.

    windows: the number of periodic windows that the sweeps passed while they followed a chaotic motion.
    """

    low: ExtentEnd
    high: ExtentEnd
    windows: int = 0


def epsilon_search_range(gear: AnyGear, map_range: Pair | None) -> Pair:
    """Return the range of ε in which motions are followed.

    The range begins at 0 and ends at the largest of three eccentricities: the upper end of `map_range`, twice the quiet
    limit, and 1.05 times the ε of the gear. map_range: range of ε of the map, None if there is no map.

    Returns
    -------
    Pair
        Lowest and highest ε.
    """
    return 0.0, max(map_range[1] if map_range else 0.0, 2.0 * gear.quiet_limit, 1.05 * gear.epsilon)


def epsilon_extent_of_motion(gear: AnyGear, attractor: rattle.Attractor, within: Pair) -> MotionExtent | None:
    """Return the range of ε in which an attractor attracts; None for undecided samples.

    The range of quiet motion is from 0 to the quiet limit. All other ranges are cut off at the ends of `within`.
    attractor: an attractor of the point, or the entry of its undecided samples (kind "undecided").

    Returns
    -------
    MotionExtent | None
        The range.
    """
    if attractor.kind == "undecided":
        return None
    if attractor.kind == "quiet":
        return MotionExtent(ExtentEnd(RANGE, 0.0), ExtentEnd(QUIET_LIMIT, gear.quiet_limit))
    if attractor.kind == "periodic" and attractor.n_plus + attractor.n_minus <= MOST_IMPACTS:
        # after an error, for example if Newton's method fails close to grazing, the motion is swept
        with suppress(RattleError):
            branch = _branch_of(gear, attractor, within)
            if branch is not None:
                return _extent_of_branch(branch, within)
    return _swept_extent(gear, attractor, within)


def add_crisis_to_extents(
    gear: AnyGear, attractors: Sequence[rattle.Attractor], extents: Sequence[MotionExtent | None]
) -> tuple[MotionExtent | None, ...]:
    """Return extents with the boundary crisis at the gear's δ as the upper end of chaos, if a sweep bracketed that end.

    The bracketed end is kept if its distance from the crisis is larger than the width of the bracket.

    Returns
    -------
    tuple[MotionExtent | None, ...]
        The extents, as many and in the same order as `extents`.
    """
    crisis = _crisis_epsilon(gear) if Capability.CRISIS in model_of_gear(gear).has else None
    if crisis is None:
        return tuple(extents)
    # attractors beyond MOST_FOLLOWED have no extent
    pairs = zip(attractors, extents, strict=False)
    return tuple(
        _replace_end_by_crisis(each, crisis) if each and one.kind == "chaotic" else each for one, each in pairs
    )


def has_bracketed_chaos_end(attractors: Sequence[rattle.Attractor], extents: Sequence[MotionExtent | None]) -> bool:
    """Return whether a sweep bracketed the upper end in ε of a chaotic attractor, for `add_crisis_to_extents`."""
    pairs = zip(attractors, extents, strict=False)  # attractors beyond MOST_FOLLOWED have no extent
    return any(one.kind == "chaotic" and each is not None and each.high.kind == SWEPT for one, each in pairs)


def _crisis_epsilon(gear: AnyGear) -> float | None:
    from rattle.crisis import boundary_crisis

    with suppress(RattleError):
        return boundary_crisis(gear.delta, gear.beta).epsilon
    return None


def _replace_end_by_crisis(extent: MotionExtent, crisis: float) -> MotionExtent:
    high = extent.high
    if high.kind != SWEPT or abs(high.epsilon - crisis) > 2.0 * high.error:
        return extent
    return extent._replace(high=high._replace(kind=CRISIS, epsilon=crisis, error=0.0))


def _branch_of(gear: AnyGear, attractor: rattle.Attractor, within: Pair) -> Any:
    """Return the branch of a periodic attractor along ε; None for a model without branches."""
    orbit = gear.orbit(attractor.tau, attractor.v, attractor.n_plus)
    if isinstance(orbit, PeriodicOrbit):
        return rattle.branch(orbit, "epsilon", within)
    return stiff_branch(orbit, "epsilon", within) if isinstance(orbit, StiffOrbit) else None


def _extent_of_branch(branch: Any, within: Pair) -> MotionExtent:
    """Return the extent of the attracting part of a branch around the point from which the branch was followed."""
    # Only branches of the stiff gear have `grazes`. A graze ends such a branch: it lies after the last point, or before
    # the first point. In the second case `after` is 0, and is replaced by −1, the index before that of the first point.
    grazes = [(each, each.after or -1) for each in getattr(branch, "grazes", ())]
    events = [(each, _index_of_point_before(each, branch)) for each in branch.events if each.admissible] + grazes
    attracts = branch.stable & branch.admissible

    def end_towards(sign: int) -> ExtentEnd:
        point = branch.start
        while True:
            beyond, is_last = point + sign, not 0 <= point + sign < len(branch)
            before = min(point, beyond)  # index of the point before the events between `point` and `beyond`
            here = [event for event, at in events if at == before][::sign]
            if here and (is_last or here[0].kind in (SADDLE_NODE, FLIP) or not attracts[beyond]):
                return _extent_end_at_event(here[0], branch, not is_last and bool(branch.admissible[beyond]))
            if is_last and branch.ends[sign > 0] == "span":
                return ExtentEnd(RANGE, within[sign > 0])
            if is_last or not attracts[beyond]:
                return ExtentEnd(LOST, float(branch.epsilon[point]))
            point = beyond

    return MotionExtent(end_towards(-1), end_towards(1))


def _index_of_point_before(event: Any, branch: Any) -> int:
    """Return the index of the last branch point before an event; −1 for a flip at which the branch begins."""
    is_origin = event.itinerary.m < branch.m and event.after == 0 and branch.ends[0] != "span"
    return -1 if is_origin else int(event.after)


def _extent_end_at_event(event: Any, branch: Any, remains: bool) -> ExtentEnd:
    """Return the end of a motion at an event of its branch. remains: True if the motion exists beyond the event."""
    next_motion = getattr(event, "beyond", None)
    return ExtentEnd(
        str(event.kind),
        float(event.parameters[1]),
        curve=branch.curve_of(event) or "",
        motion_beyond="" if next_motion is None else legend_name(next_motion.label),
        remains=remains and event.kind == FLIP and event.itinerary.m == branch.m,
    )


def _swept_extent(gear: AnyGear, attractor: rattle.Attractor, within: Pair) -> MotionExtent:
    """Return the range of ε in which an attractor attracts, found by following its states in steps to either side."""
    (low, below), (high, above) = (_sweep_towards_end(gear, attractor, end, within) for end in within)
    return MotionExtent(low, high, below + above)


def _sweep_towards_end(gear: AnyGear, attractor: rattle.Attractor, end: float, within: Pair) -> tuple[ExtentEnd, int]:
    """Follow an attractor in steps of ε towards `end`. If a step loses the attractor, halve the step and repeat it.

    Returns
    -------
    ExtentEnd
        The end of the attractor, or of the range.
    int
        The number of periodic windows of chaos that the sweep passed.
    """
    way = 1.0 if end > gear.epsilon else -1.0
    longest = (within[1] - within[0]) / STEPS
    at, step, known, windows = gear.epsilon, longest, attractor, 0
    while at != end:
        there = end if abs(end - at) <= step else at + way * step
        found = _continue_attractor(gear, known, at, there)
        same = _attractor_of_same_name(attractor, found)
        if same is not None:
            at, known, step = there, same, min(2.0 * step, longest)
            continue
        if step > max(SMALLEST_STEP * longest, min(FINEST_STEP * longest, NEAR_SHARE * abs(at - gear.epsilon))):
            step /= 2.0
            continue
        passed = _find_chaos_after_window(gear, attractor, found, there, way * longest, end)
        if passed is None:
            return ExtentEnd(SWEPT, (at + there) / 2, abs(there - at) / 2, motion_beyond=legend_name(found[0])), windows
        (at, known), step, windows = passed, longest, windows + 1
    return ExtentEnd(RANGE, end), windows


def _continue_attractor(
    gear: AnyGear, known: rattle.Attractor, from_epsilon: float, to_epsilon: float
) -> tuple[rattle.Attractor, ...]:
    """Continue an attractor: return the attractors at ε = `to_epsilon` that its states at `from_epsilon` reach.

    Returns
    -------
    tuple[rattle.Attractor, ...]
        The attractors; the first is the attractor that most of the states reach.
    """
    model = model_of_gear(gear)
    tau, v = np.array([known.tau]), np.array([known.v])
    if known.kind == "chaotic":
        every = np.full(STATES, 1.0)
        states = model.gear(gear.delta, from_epsilon).iterate(tau * every, v * every, RETURNS * np.arange(STATES))
        tau, v = states.tau, states.v
    return model.gear(gear.delta, to_epsilon).reached(tau, v).attractors


def _attractor_of_same_name(attractor: rattle.Attractor, found: Iterable[rattle.Attractor]) -> rattle.Attractor | None:
    """Return the first attractor in `found` that has the same name in legends as `attractor`; None without one."""
    names = (each for each in found if legend_name(each) == legend_name(attractor))
    return next(names, None)


def _find_chaos_after_window(
    gear: AnyGear, attractor: rattle.Attractor, found: Sequence[rattle.Attractor], at: float, step: float, end: float
) -> tuple[float, rattle.Attractor] | None:
    """Follow the motion in a periodic window of chaos, and return the ε and the attractor where chaos begins again.

    The motion is followed in at most WINDOW_STEPS steps of size `step` in ε, from `at` and not beyond `end`. attractor:
    the attractor that a sweep followed up to the window. found: the attractors at ε = `at`, just inside the window;
    the motion in the window is the first of them.

    Returns
    -------
    tuple[float, rattle.Attractor] | None
        The eccentricity and the chaotic attractor there; None if `attractor` is not chaotic, if the motion in the
        window is not periodic, or if no chaos follows.
    """
    if attractor.kind != "chaotic":
        return None
    for _ in range(WINDOW_STEPS):
        there = at + step
        if found[0].kind != "periodic" or (there - end) * step > 0:
            return None
        found, at = _continue_attractor(gear, found[0], at, there), there
        again = _attractor_of_same_name(attractor, found)
        if again is not None:
            return at, again
    return None
