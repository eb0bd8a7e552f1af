"""The registry of the bifurcation curves of the period-one motions. To add a curve, add a `CurveDefinition` to CURVES.

A curve has a motion (the walls that it meets), a condition on that motion (`rattle.continuation.conditions`), starting
points, and a rule that decides which solutions belong to the curve.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rattle.continuation.conditions import EventKind
from rattle.continuation.curve_continuation import QUIET_LIMIT
from rattle.errors import require_one_of
from rattle.impacting.bifurcations import starts
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.orbits.equations import Itinerary
from rattle.numerics.complex_step import Array

# an event lies on a curve if the curve has a starting point at the event's damping whose ε differs from the event's ε
# by less than this share of the event's ε
SAME_START = 0.01
PAPER = "Mason and Piiroinen (2009)"


@dataclass(frozen=True)
class CurveDefinition:
    """The definition of a bifurcation curve: the motion that bifurcates, which meets `walls`, and its condition `kind`.

    Attributes
    ----------
    meaning : str
        The event, and the orbits that it changes.
    starting_points_at : callable
        A function of (δ, β) that returns guesses of the unknowns (n + 2,) of the curve's points at this damping.
    reason_not_on_curve : callable
        A function of a solution (n + 2,) that returns None if the solution is on this curve, else the reason why not.
    impact : int or None
        Number of the impact that grazes; None if the condition is not a graze.
    """

    walls: tuple[int, ...]
    kind: EventKind
    meaning: str
    source: str
    starting_points_at: Callable[[float, float], Sequence[Array]]
    impact: int | None = None
    reason_not_on_curve: Callable[[Array], str | None] = lambda _: None

    def itinerary(self, beta: float) -> Itinerary:
        """Return the itinerary of the motion at this half-backlash."""
        return Itinerary(self.walls, 1, beta)


def _reason_not_on_g1(x: Array) -> str | None:
    """Return None for a graze of C, which is on G1, and the reason why a graze of A is not on G1.

    G1 and G2 are parts of one smooth curve, which SN1 touches at the point between them, where cos 2πτ = 0.

    Returns
    -------
    str | None
        The reason why a solution is not on G1.
    """
    return None if np.cos(2 * np.pi * x[0]) >= 0.0 else "the grazing motion is A from here on, on G2"


def _reason_not_on_g2(x: Array) -> str | None:
    """Return None for a graze of A, which is on G2, and the reason why a graze of C is not on G2."""
    return None if np.cos(2 * np.pi * x[0]) <= 0.0 else "the grazing motion is C from here on, on G1"


def _guess_flip_on_pd1(delta: float, beta: float) -> Sequence[Array]:
    """Return the first flip of D after SN2, in a sequence that is empty if D does not lose stability there."""
    found = starts.two_impact_flips(delta, beta)
    return found[:1] if found and starts.loses_stability_at_flip(found[0], beta) else ()


def _guess_flips_on_pd2(delta: float, beta: float) -> Sequence[Array]:
    """Return the flips of D on PD2: all flips but that of `_guess_flip_on_pd1`, ordered by σ of `TwoImpactFamily`."""
    return starts.two_impact_flips(delta, beta)[len(_guess_flip_on_pd1(delta, beta)) :]


#: The curves in the order of the legend: the five of the paper, then the others.
CURVES: dict[str, CurveDefinition] = {
    "SN1": CurveDefinition(
        (1,),
        EventKind.SADDLE_NODE,
        "saddle-node at which A and C, P(1,1,0), are born as ε grows; ends at COD22",
        f"{PAPER}, equation (4.1)",
        lambda delta, _: starts.find_single_impact_starting_points(EventKind.SADDLE_NODE, delta),
    ),
    "SN2": CurveDefinition(
        (1, -1),
        EventKind.SADDLE_NODE,
        "saddle-node at which B and D, P(1,1,1), are born as ε grows; ends at COD23",
        f"{PAPER}, section 5.2, Figure 7",
        starts.two_impact_folds,
    ),
    "PD1": CurveDefinition(
        (1, -1),
        EventKind.FLIP,
        "flip (period doubling) at which D, P(1,1,1), loses stability as ε grows; ends at COD23",
        f"{PAPER}, section 5.2, Figure 7",
        _guess_flip_on_pd1,
    ),
    "G1": CurveDefinition(
        (1, -1),
        EventKind.GRAZING,
        "grazing of C, P(1,1,0), on Σ⁻: there C and B (beyond COD23: D) become one; ends at COD22",
        f"{PAPER}, section 5.2, Figure 7",
        starts.two_impact_grazes,
        impact=1,
        reason_not_on_curve=_reason_not_on_g1,
    ),
    "G2": CurveDefinition(
        (1, -1),
        EventKind.GRAZING,
        "grazing of A, P(1,1,0), on Σ⁻: there A and D become one; begins at COD22",
        f"{PAPER}, section 5.2, Figure 7",
        starts.two_impact_grazes,
        impact=1,
        reason_not_on_curve=_reason_not_on_g2,
    ),
    "PDC": CurveDefinition(
        (1,),
        EventKind.FLIP,
        "flip (period doubling) at which C, P(1,1,0), loses stability as ε grows; ends on G1 at COD20",
        "not in the paper; closed form in rattle.flip",
        lambda delta, _: starts.find_single_impact_starting_points(EventKind.FLIP, delta),
    ),
    "PD2": CurveDefinition(
        (1, -1),
        EventKind.FLIP,
        "flip at which D, P(1,1,1), becomes stable again at high ε; beyond the fold of this curve, at "
        "which D loses stability again",
        "not in the paper",
        _guess_flips_on_pd2,
    ),
}

QUIET_MEANING = "limit of permanent contact with Σ⁺: above it the contact force changes sign; ε = 2δ/√(4π² + δ²)"

NAMES = (*CURVES, QUIET_LIMIT)


def describe(name: str) -> str:
    """Return a description of a curve: event, orbits and source. Raises ParameterError if the name is unknown."""
    require_one_of("name", name, NAMES)
    if name == QUIET_LIMIT:
        return f"{QUIET_MEANING} ({PAPER}, section 3.1, has no formula)"
    return f"{CURVES[name].meaning} ({CURVES[name].source})"


def curve_name_of_event(event: Event) -> str | None:
    """Return the name of the registered curve on which an event of a branch lies; None if it lies on no such curve."""
    walls, x, beta = event.itinerary.walls, event.unknowns, event.itinerary.beta
    near: list[tuple[float, str]] = []
    for name, curve in CURVES.items():
        if (curve.walls, curve.kind, curve.impact) == (walls, event.kind, event.impact) and curve.reason_not_on_curve(
            x
        ) is None:
            near += [
                (abs(float(start[-1]) - event.epsilon), name) for start in curve.starting_points_at(event.delta, beta)
            ]
    nearest = min(near, default=(np.inf, ""))
    return nearest[1] if nearest[0] < SAME_START * event.epsilon else None
