"""The bifurcation curves of the inelastic gear's period-one motions, with the names that they have at r = 1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rattle.continuation.conditions import EventKind
from rattle.continuation.curve_continuation import QUIET_LIMIT
from rattle.errors import require_one_of
from rattle.impacting.bifurcations.registry import CURVES as ELASTIC_CURVES
from rattle.inelastic.bifurcations import starts
from rattle.inelastic.orbits.equations import InelasticItinerary
from rattle.numerics.complex_step import Array

Starts = Callable[[float, float, float], Sequence[Array]]  # functions that return starting points at (δ, β, r)


@dataclass(frozen=True)
class InelasticCurveDefinition:
    """The definition of a curve of the elastic gear (`rattle.impacting.bifurcations.registry`) at any restitution.

    `starting_points_at` is a function of (δ, β, r). It returns guesses of the unknowns (n + 2,): n impact times, then δ
    and ε.
    """

    name: str
    meaning: str
    starting_points_at: Starts

    @property
    def walls(self) -> tuple[int, ...]:
        """The walls that the motion meets, in order."""
        return ELASTIC_CURVES[self.name].walls

    @property
    def kind(self) -> EventKind:
        """The kind of event on the curve."""
        return ELASTIC_CURVES[self.name].kind

    @property
    def impact(self) -> int | None:
        """The number of the impact that grazes; None if the event is not a graze."""
        return ELASTIC_CURVES[self.name].impact

    def reason_not_on_curve(self, x: Array) -> str | None:
        """Return None if the solution x is on this curve, else the reason in words why it is not on the curve."""
        return ELASTIC_CURVES[self.name].reason_not_on_curve(x)

    def itinerary(self, beta: float, restitution: float) -> InelasticItinerary:
        """Return the itinerary of the motion on the curve, at this half-backlash and restitution."""
        return InelasticItinerary(self.walls, 1, beta, restitution)


_DEFINITIONS = (
    InelasticCurveDefinition(
        "SN1",
        "saddle-node at which A and C, P(1,1,0), are born as ε grows; closed form for any restitution",
        lambda delta, _beta, r: starts.one_impact_guesses(EventKind.SADDLE_NODE, delta, r),
    ),
    InelasticCurveDefinition(
        "SN2", "saddle-node at which B and D, P(1,1,1), are born as ε grows", starts.saddle_node_guesses
    ),
    InelasticCurveDefinition(
        "PD1", "flip (period doubling) at which D, P(1,1,1), loses stability as ε grows", starts.flip_next_to_sn2
    ),
    InelasticCurveDefinition(
        "G1", "grazing of C, P(1,1,0), on Σ⁻: there C and B or D become one", starts.graze_guesses
    ),
    InelasticCurveDefinition("G2", "grazing of A, P(1,1,0), on Σ⁻: there A and D become one", starts.graze_guesses),
    InelasticCurveDefinition(
        "PDC",
        "flip (period doubling) at which C, P(1,1,0), loses stability as ε grows; closed form for any restitution",
        lambda delta, _beta, r: starts.one_impact_guesses(EventKind.FLIP, delta, r),
    ),
    InelasticCurveDefinition(
        "PD2", "flip at which D, P(1,1,1), becomes stable again at high ε", starts.flips_except_next_to_sn2
    ),
)
#: The curves in the order in which a picture's legend lists them.
INELASTIC_CURVES = {each.name: each for each in _DEFINITIONS}
#: Description of the quiet limit, which has no entry in INELASTIC_CURVES.
QUIET_MEANING = "limit of permanent contact with Σ⁺: above it the contact force changes sign, at any restitution"
NAMES = (*INELASTIC_CURVES, QUIET_LIMIT)


def describe(name: str) -> str:
    """Return a description of a curve, its event and its orbits. Raises ParameterError on an unknown name."""
    require_one_of("name", name, NAMES)
    return QUIET_MEANING if name == QUIET_LIMIT else INELASTIC_CURVES[name].meaning
