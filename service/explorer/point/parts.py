"""Compute the view of one parameter point: functions of a gear that other processes can run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import rattle
from gear_rattle.service.explorer.design import rattling
from gear_rattle.service.operations import diagrams
from rattle import Diagram
from rattle.attractors import attractors_of_cell, classified, sampled_speed
from rattle.continuation import plane_scale
from rattle.flight import wrapped
from rattle.models import AnyGear, Capability, model_at, require_capability

ARCLENGTH, SPACING = 60.0, 0.02  # of manifolds and Γ on a screen
MOST_POINTS = 8000  # of it that are drawn
SAME_ORBIT = 1e-6
CELL_NAMES = {f"attractor_{name}" for name in ("kind", "m", "n_plus", "n_minus", "fraction")}
Array = NDArray[np.float64]


def largest_sampled_speed(delta: float, epsilon: float, beta: float) -> float:
    """Return the largest speed of states that a view shows: the paper's in its plane, the natural one elsewhere."""
    return sampled_speed(None, delta, epsilon, beta)


class Chances(NamedTuple):
    """The attractors, each with its two Floquet multipliers or None, and its letter if it is one of A to D."""

    starts: int
    attractors: tuple[rattle.Attractor, ...]
    multipliers: tuple[tuple[complex, complex] | None, ...]
    letters: tuple[str, ...]


class PeriodOneOrbits(NamedTuple):
    """The number of the region in `rattle.REGIONS`, and the motions A to D that happen."""

    region: int
    orbits: tuple[rattle.Orbit, ...]


class Margin(NamedTuple):
    """Least impact that ends quiet motion, as `Gear.boundary_distance`.

    With the motion that it leads to, and the speed up to which it was searched.
    """

    v: float
    tau: float
    undecided: float
    leads_to: rattle.Attractor | None
    v_max: float


class Elsewhere(NamedTuple):
    """Basins, and the motions A to D that happen, none where that is no closed form."""

    basins: rattle.Basins
    orbits: tuple[rattle.Orbit, ...]


class PlaneLine(NamedTuple):
    """A line of the (τ, v) plane, points (k, 2) with NaN between pieces."""

    name: str
    points: Array


class SpectrumLines(NamedTuple):
    """Γ and the manifolds of the saddles A and B, and a sentence for each that is missing."""

    lines: tuple[PlaneLine, ...]
    missing: tuple[str, ...]


class Stroke(NamedTuple):
    """A piece of a branch in a diagram: parameter, v and τ of one impact on Σ⁺; what motion, and whether stable."""

    x: Array
    v: Array
    tau: Array
    motion: str
    stable: bool


class Marks(NamedTuple):
    """The impacts (n,) of all events.

    Parameter, v, τ, the kind (SN, PD, GR), the name of the event's curve or "", and the motion that it happens to.
    """

    x: Array
    v: Array
    tau: Array
    kind: tuple[str, ...]
    name: tuple[str, ...]
    motion: tuple[str, ...]


class Happening(NamedTuple):
    """An event: its kind (SN, PD, GR), the name of its curve or "", its motion, δ, ε and multipliers there."""

    kind: str
    name: str
    motion: str
    delta: float
    epsilon: float
    multipliers: tuple[complex, complex]


class DiagramLines(NamedTuple):
    """A one-parameter diagram: branches, events, and the states (n,) of attractors that sweeps see.

    Along which axis, or as fractions of the way to a point `to`. upward: whether the sweep that saw a state went
    towards larger x.
    """

    direction: str
    to: tuple[float, float] | None
    span: tuple[float, float]
    strokes: tuple[Stroke, ...]
    marks: Marks
    events: tuple[Happening, ...]
    x: Array
    v: Array
    tau: Array
    upward: NDArray[np.bool_]


def listed_in(cell: xr.Dataset) -> Iterator[tuple[xr.Dataset, str, tuple[int, int, int], int]]:
    """Yield the attractors that a survey's cell lists: what it holds of each, its kind, (m, n₊, n₋), contact phases."""
    for slot in range(cell.sizes["attractor"]):
        one = cell.isel(attractor=slot)
        kind = rattle.KINDS[int(one["attractor_kind"])]
        if kind != "none":
            label = (int(one["attractor_m"]), int(one["attractor_n_plus"]), int(one["attractor_n_minus"]))
            yield one, kind, label, int(one["attractor_contacts"]) if "attractor_contacts" in one else 0


def chances_of_cell(cell: xr.Dataset, starts: int) -> Chances | None:
    """Return the attractors of a survey's cell, None unless it lists all that its sample went to."""
    if not set(cell.data_vars) >= CELL_NAMES:
        return None
    found, nan = [], float("nan")
    for one, kind, label, contacts in listed_in(cell):
        share = float(one["attractor_fraction"])
        low, high = rattle.wilson_interval(share * starts, starts)
        interval = float(low), float(high)
        found.append(rattle.Attractor(kind, *label, share, interval, (nan, nan), nan, nan, nan, contacts))
    if not abs(sum(each.fraction for each in found) - 1.0) < 0.5 / starts:
        return None
    found.sort(key=lambda each: -each.fraction)
    return Chances(starts, tuple(found), (None,) * len(found), ("",) * len(found))


def chances(gear: AnyGear, count: int) -> Chances:
    """Return the attractors of a sample of so many initial conditions; letters where they cost nothing."""
    found = gear.attractors(count)
    multipliers = tuple(_multipliers(gear, each) for each in found)
    orbits = gear.orbits() if model_at(gear).in_closed_form else ()
    return Chances(count, found, multipliers, tuple(_letter(orbits, each) for each in found))


def period_one(gear: AnyGear) -> PeriodOneOrbits:
    """Return the period-one motions and their region: at once where they are closed forms, else by continuation."""
    return PeriodOneOrbits(gear.region(), gear.orbits())


def _multipliers(gear: AnyGear, attractor: rattle.Attractor) -> tuple[complex, complex] | None:
    if attractor.kind != "periodic":
        return None
    state = attractor.tau, attractor.v, attractor.n_plus
    try:
        orbit = gear.orbit(*state)
    except rattle.RattleError:  # too close to grazing for Newton's method: the table says nothing then
        return None
    first, second = orbit.multipliers
    return complex(first), complex(second)


def lettered(found: Chances, orbits: Iterable[rattle.Orbit]) -> Chances:
    """Return the same with the letters of these period-one motions."""
    return found._replace(letters=tuple(_letter(orbits, each) for each in found.attractors))


def _letter(orbits: Iterable[rattle.Orbit], attractor: rattle.Attractor) -> str:
    for orbit in orbits:
        if abs(orbit.v - attractor.v) < SAME_ORBIT and abs(wrapped(orbit.tau - attractor.tau)) < SAME_ORBIT:
            return orbit.name
    return ""


def margin(gear: Any) -> Margin:
    """Return how hard an impact loses quiet motion, of a gear whose model has a margin."""
    v, tau, undecided = gear.boundary_distance()
    leads_to = None
    if 0 < v < np.inf:
        table, _, _ = classified(gear.states, np.array([tau]), np.array([v]))
        (leads_to,) = attractors_of_cell(table, table.samples)
    return Margin(v, tau, undecided, leads_to, largest_sampled_speed(gear.delta, gear.epsilon, gear.beta))


def lines(gear: AnyGear, arclength: float = ARCLENGTH) -> SpectrumLines:
    """Γ where there is one, W^s of A and B, and W^u of A, by default as far as a screen shows them."""
    require_capability(Capability.MANIFOLDS, model_at(gear))
    from rattle.plot import gamma_line, manifold_line

    orbits = {orbit.name: orbit for orbit in gear.orbits()}
    found = (
        [PlaneLine("Γ", gamma_line(gear, largest_sampled_speed(gear.delta, gear.epsilon, gear.beta), SPACING))]
        if Capability.GAMMA in model_at(gear).has
        else []
    )
    missing = []
    for name, kind in (("A", "stable"), ("B", "stable"), ("A", "unstable")):
        line, why = manifold_line(gear, orbits.get(name), name, kind, arclength, SPACING)
        found.append(PlaneLine(f"W{'ˢ' if kind == 'stable' else 'ᵘ'}({name})", line))
        if why:
            missing.append(why)
    return SpectrumLines(tuple(line for line in found if len(line.points)), tuple(missing))


def diagram(
    gear: AnyGear,
    direction: str,
    either_way: float | None = None,
    to: tuple[float, float] | None = None,
    steps: int | None = None,
    count: int | None = None,
) -> DiagramLines:
    """Return the one-parameter diagram through the point, along "epsilon" or "delta", or to another point.

    As far either way as requested; or from there to another point (δ, ε).

    Returns
    -------
    DiagramLines
        The lines of the diagram.
    """
    from rattle.plot import curves_along, impacts_at, parameter_axis, strokes
    from rattle.plot import legend_name as name_of_type

    require_capability(Capability.DIAGRAMS, model_at(gear))
    span = (0.0, 1.0) if to is not None else diagrams.diagram_span(gear, direction, either_way)
    ends = diagrams.diagram_ends(gear, direction, either_way, to)
    found: Diagram[Any, Any] = model_at(gear).diagram(*ends, steps or diagrams.STEPS, count or diagrams.COUNT)
    scale, offset = (1.0, 0.0) if to is not None else parameter_axis(found)[1:]
    pieces = []
    for branch in found.branches:
        for curve in curves_along(found, branch, scale, offset):
            for stable, part in strokes(curve):
                named = curve.name[part.start]
                motion = name_of_type(branch.label) + (f", {named}" if named else "")
                pieces.append(Stroke(curve.x[part], curve.v[part], curve.tau[part], motion, stable))
    rows = [
        (
            *(offset + scale * float(found.positions(event)), v, tau),
            *(event.kind.value, found.curve_of(event) or "", name_of_type(event.itinerary.label)),
        )
        for event in found.events
        for tau, v in zip(*impacts_at(event), strict=True)
    ]
    x, v, tau, kind, name, motions = zip(*rows, strict=True) if rows else ((), (), (), (), (), ())
    marks = Marks(
        np.array(x, float), np.array(v, float), np.array(tau, float), tuple(kind), tuple(name), tuple(motions)
    )
    events = tuple(
        Happening(
            event.kind.value, found.curve_of(event) or "", name_of_type(event.itinerary.label),
            float(event.parameters[0]), float(event.parameters[1]), event.orbit.multipliers,
        )
        for event in found.events
    )  # fmt: skip
    seen = found.points
    chosen = np.arange(0, seen.v.size, max(1, seen.v.size // MOST_POINTS))
    return DiagramLines(
        direction,
        to,
        span,
        tuple(pieces),
        marks,
        events,
        offset + scale * seen.position[chosen],
        seen.v[chosen],
        seen.tau[chosen],
        seen.forward[chosen],
    )


def basins(gear: AnyGear, side: int, method: str) -> rattle.Basins:
    """Basins on side × side cells."""
    return gear.basins(side, None, method)


def elsewhere(gear: AnyGear, side: int, method: str) -> Elsewhere:
    """Return the basins and orbits of a gear beside the point's own."""
    orbits = gear.orbits() if model_at(gear).in_closed_form else ()
    return Elsewhere(basins(gear, side, method), orbits)


def motion_from(gear: AnyGear, tau: float, v: float, periods: float, points: int) -> rattle.Trajectory:
    """Return the motion from one state."""
    return gear.trajectory(tau, v, periods, points)


def warm_up(gear: AnyGear) -> None:
    """Load every kernel that a point of this model needs: run each part, as small as it gets."""
    chances(gear, 16)
    for method in ("cells", "refined", "direct"):
        basins(gear, 20, method)
    motion_from(gear, 0.3, 4.0, 1.0, 2)
    rattling.warm_up_sounds(gear)
    has = model_at(gear).has
    if Capability.MANIFOLDS in has:
        lines(gear, arclength=1.0)
    if Capability.MARGIN in has:
        margin(gear)
    if Capability.DIAGRAMS in has:
        diagram(
            gear, "epsilon", steps=4, count=4, either_way=0.25 * diagrams.SPANS["epsilon"] * plane_scale(gear.delta)
        )
