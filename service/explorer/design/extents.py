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
from rattle.models import AnyGear, Capability, model_at
from rattle.plot import legend_name
from rattle.stiff import StiffOrbit, stiff_branch

MOST_FOLLOWED, MOST_IMPACTS = 12, 64  # most attractors that are followed, and most impacts of a motion on a branch
STEPS = 150  # steps of a sweep over the whole range of ε
STATES, RETURNS = 16, 37  # states of a chaotic attractor that a sweep follows, and returns between two of them
WINDOW = 4  # steps of a periodic window that a sweep of chaos passes
FINEST, NEAR, LEAST = 1 / 32, 1 / 8, 1e-9  # width of a bracket over a step, over its distance, and over the range

#: Kinds of an end: events of a branch as rattle names them, then the ends that are no event.
SADDLE_NODE, FLIP, GRAZING = "SN", "PD", "GR"
CRISIS, QUIET_LIMIT, SWEPT, RANGE, LOST = "crisis", "quiet limit", "swept", "range", "lost"


class End(NamedTuple):
    """One end of the range of ε in which a motion attracts.

    kind: SN, PD or GR for an event of the branch; "crisis", "quiet limit"; "swept" for a bracket; "range" if the motion
    attracts up to the end of the range, "lost" if it could not be followed farther. error: half the width of the
    bracket, 0 if the end is exact. curve: the curve of the map on which the event lies, or "". beyond: the attractor
    that a sweep reaches beyond the end, or "". remains: whether the motion exists beyond the end without attracting.
    """

    kind: str
    epsilon: float
    error: float = 0.0
    curve: str = ""
    beyond: str = ""
    remains: bool = False


class Extent(NamedTuple):
    """The range of ε in which a motion attracts. windows: the number of periodic windows that a sweep of chaos met."""

    low: End
    high: End
    windows: int = 0


def followed_range(gear: AnyGear, map_range: Pair | None) -> Pair:
    """Return the range of ε in which motions are followed: from 0, beyond the map and beyond twice the quiet limit."""
    return 0.0, max(map_range[1] if map_range else 0.0, 2.0 * gear.quiet_limit, 1.05 * gear.epsilon)


def motion_extent(gear: AnyGear, attractor: rattle.Attractor, within: Pair) -> Extent | None:
    """Return the extent of one attractor in the range `within` of ε; None if it is undecided."""
    if attractor.kind == "undecided":
        return None
    if attractor.kind == "quiet":
        return Extent(End(RANGE, 0.0), End(QUIET_LIMIT, gear.quiet_limit))
    if attractor.kind == "periodic" and attractor.n_plus + attractor.n_minus <= MOST_IMPACTS:
        with suppress(RattleError):  # the motion is too close to grazing for Newton's method, so it is swept
            branch = _branch_of(gear, attractor, within)
            if branch is not None:
                return _extent_of_branch(branch, within)
    return _swept_extent(gear, attractor, within)


def add_crisis(gear: AnyGear, extents: Sequence[Extent | None]) -> tuple[Extent | None, ...]:
    """Replace the swept upper end of chaos by the boundary crisis if the crisis of this damping lies at it."""
    crisis = _crisis(gear) if Capability.CRISIS in model_at(gear).has else None
    return tuple(each if each is None or crisis is None else _ends_in(each, crisis) for each in extents)


def has_swept_chaos(attractors: Sequence[rattle.Attractor], extents: Sequence[Extent | None]) -> bool:
    """Return whether the upper end of a chaotic attractor is a bracket, which a crisis may explain."""
    pairs = zip(attractors, extents, strict=False)  # attractors beyond MOST_FOLLOWED have no extent
    return any(one.kind == "chaotic" and each is not None and each.high.kind == SWEPT for one, each in pairs)


def _crisis(gear: AnyGear) -> float | None:
    from rattle.crisis import boundary_crisis

    with suppress(RattleError):
        return boundary_crisis(gear.delta, gear.beta).epsilon
    return None


def _ends_in(extent: Extent, crisis: float) -> Extent:
    high = extent.high
    if high.kind != SWEPT or abs(high.epsilon - crisis) > 2.0 * high.error:
        return extent
    return extent._replace(high=high._replace(kind=CRISIS, epsilon=crisis, error=0.0))


def _branch_of(gear: AnyGear, attractor: rattle.Attractor, within: Pair) -> Any:
    """Return the branch of a periodic attractor along ε; None for a model whose motions are on no branch."""
    orbit = gear.orbit(attractor.tau, attractor.v, attractor.n_plus)
    if isinstance(orbit, PeriodicOrbit):
        return rattle.branch(orbit, "epsilon", within)
    return stiff_branch(orbit, "epsilon", within) if isinstance(orbit, StiffOrbit) else None


def _extent_of_branch(branch: Any, within: Pair) -> Extent:
    """Return the extent of the attracting part of a branch around the point from which the branch was followed."""
    grazes = [(each, each.after or -1) for each in getattr(branch, "grazes", ())]  # a branch of stiff gears ends there
    events = [(each, _piece_of(each, branch)) for each in branch.events if each.admissible] + grazes
    attracts = branch.stable & branch.admissible

    def end(way: int) -> End:
        point = branch.start
        while True:
            beyond, is_last = point + way, not 0 <= point + way < len(branch)
            piece = min(point, beyond)  # the piece of the branch between these two points
            here = [event for event, at in events if at == piece][::way]
            if here and (is_last or here[0].kind in (SADDLE_NODE, FLIP) or not attracts[beyond]):
                return _end_at(here[0], branch, not is_last and bool(branch.admissible[beyond]))
            if is_last and branch.ends[way > 0] == "span":
                return End(RANGE, within[way > 0])
            if is_last or not attracts[beyond]:
                return End(LOST, float(branch.epsilon[point]))
            point = beyond

    return Extent(end(-1), end(1))


def _piece_of(event: Any, branch: Any) -> int:
    """Return the number of the point before an event on a branch; −1 for the flip at which the branch begins."""
    is_origin = event.itinerary.m < branch.m and event.after == 0 and branch.ends[0] != "span"
    return -1 if is_origin else int(event.after)


def _end_at(event: Any, branch: Any, remains: bool) -> End:
    """Return the end of a motion at an event. remains: whether the next point of the branch is an admissible motion."""
    next_motion = getattr(event, "beyond", None)
    return End(
        str(event.kind),
        float(event.parameters[1]),
        curve=branch.curve_of(event) or "",
        beyond="" if next_motion is None else legend_name(next_motion.label),
        remains=remains and event.kind == FLIP and event.itinerary.m == branch.m,
    )


def _swept_extent(gear: AnyGear, attractor: rattle.Attractor, within: Pair) -> Extent:
    """Return the extent of an attractor, found by following its states in steps of ε to either side."""
    (low, below), (high, above) = (_sweep(gear, attractor, end, within) for end in within)
    return Extent(low, high, below + above)


def _sweep(gear: AnyGear, attractor: rattle.Attractor, end: float, within: Pair) -> tuple[End, int]:
    """Follow an attractor in steps of ε towards `end`, the steps halved where it is lost.

    Returns
    -------
    End
        The end of the attractor, or of the range.
    int
        The number of periodic windows of chaos that the sweep passed.
    """
    way = 1.0 if end > gear.epsilon else -1.0
    longest = (within[1] - within[0]) / STEPS
    at, step, known, windows = gear.epsilon, longest, attractor, 0
    while at != end:
        there = end if abs(end - at) <= step else at + way * step
        found = _continued(gear, known, at, there)
        same = _like(attractor, found)
        if same is not None:
            at, known, step = there, same, min(2.0 * step, longest)
            continue
        if step > max(LEAST * longest, min(FINEST * longest, NEAR * abs(at - gear.epsilon))):
            step /= 2.0
            continue
        passed = _after_window(gear, attractor, found, there, way * longest, end)
        if passed is None:
            return End(SWEPT, (at + there) / 2, abs(there - at) / 2, beyond=legend_name(found[0])), windows
        (at, known), step, windows = passed, longest, windows + 1
    return End(RANGE, end), windows


def _continued(gear: AnyGear, known: rattle.Attractor, at: float, there: float) -> tuple[rattle.Attractor, ...]:
    """Return the attractors at ε = `there` that states of an attractor at ε = `at` go to, by falling share."""
    model = model_at(gear)
    tau, v = np.array([known.tau]), np.array([known.v])
    if known.kind == "chaotic":
        every = np.full(STATES, 1.0)
        states = model.gear(gear.delta, at).iterate(tau * every, v * every, RETURNS * np.arange(STATES))
        tau, v = states.tau, states.v
    return model.gear(gear.delta, there).reached(tau, v).attractors


def _like(attractor: rattle.Attractor, found: Iterable[rattle.Attractor]) -> rattle.Attractor | None:
    """Return the first attractor of the same kind and label; None if there is none."""
    names = (each for each in found if legend_name(each) == legend_name(attractor))
    return next(names, None)


def _after_window(
    gear: AnyGear, attractor: rattle.Attractor, found: Sequence[rattle.Attractor], at: float, step: float, end: float
) -> tuple[float, rattle.Attractor] | None:
    """Return where chaos begins again within WINDOW steps of ε beyond the attractors `found` at ε = `at`.

    Returns
    -------
    tuple[float, rattle.Attractor] | None
        The eccentricity and the chaotic attractor there; None if the motion is not chaotic or no chaos follows.
    """
    if attractor.kind != "chaotic":
        return None
    for _ in range(WINDOW):
        there = at + step
        if found[0].kind != "periodic" or (there - end) * step > 0:
            return None
        found, at = _continued(gear, found[0], at, there), there
        again = _like(attractor, found)
        if again is not None:
            return at, again
    return None
