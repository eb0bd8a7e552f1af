"""Functions that compute the parts of the view of one parameter point. Other processes run them for a gear."""

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
from rattle.attractors import attractors_of_cell, classify_plane_states, highest_sampled_speed
from rattle.continuation import plane_scale
from rattle.flight import wrap_phase_difference
from rattle.models import AnyGear, Capability, model_of_gear, require_capability

ARCLENGTH, SPACING = 60.0, 0.02  # arclength of a drawn manifold; spacing of points on manifolds and Γ
# If the sweeps of a diagram find 2 DRAWN_POINTS states or more, only every k-th state is drawn; k is such that
# DRAWN_POINTS to 2 DRAWN_POINTS states are drawn.
DRAWN_POINTS = 8000
SAME_ORBIT = 1e-6  # an attractor and an orbit are the same motion if their τ and v differ by less than this
CELL_NAMES = {f"attractor_{name}" for name in ("kind", "m", "n_plus", "n_minus", "fraction")}
Array = NDArray[np.float64]


def largest_sampled_speed(delta: float, epsilon: float, beta: float) -> float:
    """Return the largest speed that is sampled and drawn: 7 in the paper's plane, the natural speed elsewhere."""
    return highest_sampled_speed(None, delta, epsilon, beta)


class SampledAttractors(NamedTuple):
    """Attractors that samples reached. starts: the number of samples, each with its own initial condition.

    multipliers: for each attractor its two Floquet multipliers, or None if it is not periodic or they are not known.
    letters: for each attractor its letter A to D, or "" if it is another motion or the letter is not known.
    """

    starts: int
    attractors: tuple[rattle.Attractor, ...]
    multipliers: tuple[tuple[complex, complex] | None, ...]
    letters: tuple[str, ...]


class PeriodOneOrbits(NamedTuple):
    """The number of a point's region in `rattle.REGIONS`, and the motions A to D that exist at the point."""

    region: int
    orbits: tuple[rattle.Orbit, ...]


class QuietMargin(NamedTuple):
    """Least impact that ends quiet motion, from `Gear.boundary_distance`.

    v, tau: its speed and phase; v is 0 if there is no quiet motion, inf if no such impact was found, NaN if the speed
    cannot be computed. undecided: the least speed of an impact after which it is not known whether the motion becomes
    quiet again, inf if there is no such impact. leads_to: the attractor to which the impact with speed v leads; None if
    v is 0, inf or NaN. v_max: the largest searched speed.
    """

    v: float
    tau: float
    undecided: float
    leads_to: rattle.Attractor | None
    v_max: float


class BasinsAndOrbits(NamedTuple):
    """Basins at another point than the clicked one, and the motions A to D there, if they have a closed form."""

    basins: rattle.Basins
    orbits: tuple[rattle.Orbit, ...]


class PlaneLine(NamedTuple):
    """A named line in the (τ, v) plane. points (k, 2): rows (τ, v), and rows of NaN where the line is interrupted."""

    name: str
    points: Array


class StatePlaneLines(NamedTuple):
    """Γ and the manifolds of the saddles A and B, and a sentence for each missing line."""

    lines: tuple[PlaneLine, ...]
    missing: tuple[str, ...]


class DrawnBranchPart(NamedTuple):
    """A part of a branch in a diagram; either all motions of the part are stable, or none is.

    x: the parameter. v, tau: speed and phase of one impact on Σ⁺. motion: the name of the motion.
    """

    x: Array
    v: Array
    tau: Array
    motion: str
    stable: bool


class EventImpacts(NamedTuple):
    """Impacts (n,) on Σ⁺ of all events of a diagram.

    x: the parameter. v, tau: speed and phase of the impact. kind: SN (saddle-node), PD (period doubling) or GR
    (grazing). name: the curve of the plane on which the event lies, or "". motion: the motion that has the event.
    """

    x: Array
    v: Array
    tau: Array
    kind: tuple[str, ...]
    name: tuple[str, ...]
    motion: tuple[str, ...]


class DiagramEvent(NamedTuple):
    """Event of a diagram at a point (δ, ε), with the two Floquet multipliers of its motion there.

    kind, name, motion: the kind, the curve and the motion of the event, as in `EventImpacts`.
    """

    kind: str
    name: str
    motion: str
    delta: float
    epsilon: float
    multipliers: tuple[complex, complex]


class DiagramContents(NamedTuple):
    """A one-parameter diagram: its branches (`branch_parts`), its events, and states of attractors that sweeps found.

    direction: the parameter x, "epsilon" or "delta". If `to` is not None, x is instead the position on the line from
    the open point (x = 0) to the point `to` (x = 1). span: the range of x. event_impacts: the impacts of all events. x,
    v, tau (n,): parameter, speed and phase of each state. upward (n,): True if x grew in the sweep that found the
    state.
    """

    direction: str
    to: tuple[float, float] | None
    span: tuple[float, float]
    branch_parts: tuple[DrawnBranchPart, ...]
    event_impacts: EventImpacts
    events: tuple[DiagramEvent, ...]
    x: Array
    v: Array
    tau: Array
    upward: NDArray[np.bool_]


def listed_attractors(cell: xr.Dataset) -> Iterator[tuple[xr.Dataset, str, tuple[int, int, int], int]]:
    """Yield for each attractor of a survey's cell: variables, kind, label (m, n₊, n₋), number of contact phases."""
    for slot in range(cell.sizes["attractor"]):
        one = cell.isel(attractor=slot)
        kind = rattle.KINDS[int(one["attractor_kind"])]
        if kind != "none":
            label = (int(one["attractor_m"]), int(one["attractor_n_plus"]), int(one["attractor_n_minus"]))
            yield one, kind, label, int(one["attractor_contacts"]) if "attractor_contacts" in one else 0


def attractors_of_survey_cell(cell: xr.Dataset, starts: int) -> SampledAttractors | None:
    """Return the attractors of a survey's cell. starts: number of samples of the cell.

    Returns
    -------
    SampledAttractors | None
        None if the survey lacks a variable of CELL_NAMES, or if the basin fractions of all slots do not add to 1.
    """
    if not set(cell.data_vars) >= CELL_NAMES:
        return None
    found, nan = [], float("nan")
    for one, kind, label, contacts in listed_attractors(cell):
        share = float(one["attractor_fraction"])
        low, high = rattle.wilson_interval(share * starts, starts)
        interval = float(low), float(high)
        found.append(rattle.Attractor(kind, *label, share, interval, (nan, nan), nan, nan, nan, contacts))
    if not abs(sum(each.fraction for each in found) - 1.0) < 0.5 / starts:
        return None
    found.sort(key=lambda each: -each.fraction)
    return SampledAttractors(starts, tuple(found), (None,) * len(found), ("",) * len(found))


def sampled_attractors(gear: AnyGear, count: int) -> SampledAttractors:
    """Return the attractors that `count` samples reach, with multipliers and, where A to D are known, letters."""
    found = gear.attractors(count)
    multipliers = tuple(_multipliers_of(gear, each) for each in found)
    orbits = gear.orbits() if model_of_gear(gear).has_closed_forms else ()
    return SampledAttractors(count, found, multipliers, tuple(_letter_of_attractor(orbits, each) for each in found))


def compute_period_one_orbits(gear: AnyGear) -> PeriodOneOrbits:
    """Return the period-one motions and their region: in closed form if there is one, else by continuation."""
    return PeriodOneOrbits(gear.region(), gear.orbits())


def _multipliers_of(gear: AnyGear, attractor: rattle.Attractor) -> tuple[complex, complex] | None:
    if attractor.kind != "periodic":
        return None
    state = attractor.tau, attractor.v, attractor.n_plus
    try:
        orbit = gear.orbit(*state)
    except rattle.RattleError:  # for example, too close to grazing for Newton's method: a table then has a dash
        return None
    first, second = orbit.multipliers
    return complex(first), complex(second)


def add_orbit_letters(found: SampledAttractors, orbits: Iterable[rattle.Orbit]) -> SampledAttractors:
    """Return `found` with the letter A to D of each attractor that is one of `orbits`, and "" for other attractors."""
    return found._replace(letters=tuple(_letter_of_attractor(orbits, each) for each in found.attractors))


def _letter_of_attractor(orbits: Iterable[rattle.Orbit], attractor: rattle.Attractor) -> str:
    for orbit in orbits:
        if (
            abs(orbit.v - attractor.v) < SAME_ORBIT
            and abs(wrap_phase_difference(orbit.tau - attractor.tau)) < SAME_ORBIT
        ):
            return orbit.name
    return ""


def compute_quiet_margin(gear: Any) -> QuietMargin:
    """Return the least impact that ends quiet motion. The gear's model must have `Capability.MARGIN`."""
    v, tau, undecided = gear.boundary_distance()
    leads_to = None
    if 0 < v < np.inf:
        table, _, _ = classify_plane_states(gear.states, np.array([tau]), np.array([v]))
        (leads_to,) = attractors_of_cell(table, table.samples)
    return QuietMargin(v, tau, undecided, leads_to, largest_sampled_speed(gear.delta, gear.epsilon, gear.beta))


def compute_plane_lines(gear: AnyGear, arclength: float = ARCLENGTH) -> StatePlaneLines:
    """Return Γ if the model has one, the stable manifolds of the saddles A and B, and the unstable manifold of A."""
    require_capability(Capability.MANIFOLDS, model_of_gear(gear))
    from rattle.plot import gamma_line, manifold_line

    orbits = {orbit.name: orbit for orbit in gear.orbits()}
    found = (
        [PlaneLine("Γ", gamma_line(gear, largest_sampled_speed(gear.delta, gear.epsilon, gear.beta), SPACING))]
        if Capability.GAMMA in model_of_gear(gear).has
        else []
    )
    missing = []
    for name, kind in (("A", "stable"), ("B", "stable"), ("A", "unstable")):
        line, why = manifold_line(gear, orbits.get(name), name, kind, arclength, SPACING)
        found.append(PlaneLine(f"W{'ˢ' if kind == 'stable' else 'ᵘ'}({name})", line))
        if why:
            missing.append(why)
    return StatePlaneLines(tuple(line for line in found if len(line.points)), tuple(missing))


def compute_diagram_contents(
    gear: AnyGear,
    direction: str,
    half_span: float | None = None,
    to: tuple[float, float] | None = None,
    steps: int | None = None,
    count: int | None = None,
) -> DiagramContents:
    """Return the diagram through a gear's point along "epsilon" or "delta", or from the gear's point to another point.

    Parameters
    ----------
    half_span : float | None
        Extent in δ or ε on either side of the point; None for the default.
    to : tuple[float, float] | None
        Other point (δ, ε), where the diagram ends; it then begins at the gear's own point.
    steps, count : int | None
        Number of intervals of the parameter, and of initial conditions at each of its values; None: the defaults.

    Returns
    -------
    DiagramContents
        The branches and the events of the diagram, and the states of attractors that its sweeps found.
    """
    from rattle.plot import admissible_curve_parts, impact_curves_along_branch, impacts_at_event, parameter_axis
    from rattle.plot import legend_name as name_of_type

    require_capability(Capability.DIAGRAMS, model_of_gear(gear))
    span = (0.0, 1.0) if to is not None else diagrams.diagram_span(gear, direction, half_span)
    ends = diagrams.diagram_ends(gear, direction, half_span, to)
    found: Diagram[Any, Any] = model_of_gear(gear).diagram(
        *ends, steps or diagrams.default_steps(gear), count or diagrams.COUNT
    )
    scale, offset = (1.0, 0.0) if to is not None else parameter_axis(found)[1:]
    pieces = []
    for branch in found.branches:
        for curve in impact_curves_along_branch(found, branch, scale, offset):
            for stable, part in admissible_curve_parts(curve):
                named = curve.name[part.start]
                motion = name_of_type(branch.label) + (f", {named}" if named else "")
                pieces.append(DrawnBranchPart(curve.x[part], curve.v[part], curve.tau[part], motion, stable))
    rows = [
        (
            *(offset + scale * float(found.positions(event)), v, tau),
            *(event.kind.value, found.curve_of(event) or "", name_of_type(event.itinerary.label)),
        )
        for event in found.events
        for tau, v in zip(*impacts_at_event(event), strict=True)
    ]
    x, v, tau, kind, name, motions = zip(*rows, strict=True) if rows else ((), (), (), (), (), ())
    marks = EventImpacts(
        np.array(x, float), np.array(v, float), np.array(tau, float), tuple(kind), tuple(name), tuple(motions)
    )
    events = tuple(
        DiagramEvent(
            event.kind.value, found.curve_of(event) or "", name_of_type(event.itinerary.label),
            float(event.parameters[0]), float(event.parameters[1]), event.orbit.multipliers,
        )
        for event in found.events
    )  # fmt: skip
    seen = found.points
    chosen = np.arange(0, seen.v.size, max(1, seen.v.size // DRAWN_POINTS))
    return DiagramContents(
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


def compute_basins(gear: AnyGear, side: int, method: str) -> rattle.Basins:
    """Return the basins of attraction on side × side cells of the (τ, v) plane. method: see `rattle.Gear.basins`."""
    return gear.basins(side, None, method)


def compute_basins_and_orbits(gear: AnyGear, side: int, method: str) -> BasinsAndOrbits:
    """Return the basins of attraction, and the motions A to D, of a gear at another point than the clicked one."""
    orbits = gear.orbits() if model_of_gear(gear).has_closed_forms else ()
    return BasinsAndOrbits(compute_basins(gear, side, method), orbits)


def motion_from_state(gear: AnyGear, tau: float, v: float, periods: float, points: int) -> rattle.Trajectory:
    """Return the motion from the state (τ, v) over `periods` forcing periods, at `points` times."""
    return gear.trajectory(tau, v, periods, points)


def load_point_kernels(gear: AnyGear) -> None:
    """Load all kernels that a point of the gear's model needs: compute each part of the view at a small size."""
    sampled_attractors(gear, 16)
    for method in ("cells", "refined", "direct"):
        compute_basins(gear, 20, method)
    motion_from_state(gear, 0.3, 4.0, 1.0, 2)
    rattling.load_sound_kernels(gear)
    has = model_of_gear(gear).has
    if Capability.MANIFOLDS in has:
        compute_plane_lines(gear, arclength=1.0)
    if Capability.MARGIN in has:
        compute_quiet_margin(gear)
    if Capability.DIAGRAMS in has:
        compute_diagram_contents(
            gear, "epsilon", steps=4, count=4, half_span=0.25 * diagrams.SPANS["epsilon"] * plane_scale(gear.delta)
        )
