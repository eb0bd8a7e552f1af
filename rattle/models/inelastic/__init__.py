"""The inelastic model: impacts with a coefficient of restitution, a load, and a forcing of several harmonics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from rattle import inelastic
from rattle.attractors.classify import Classifier
from rattle.continuation.curve_continuation import Curve
from rattle.errors import RattleError
from rattle.impacting.bifurcations.codimension_two import CodimensionTwo
from rattle.inelastic.attractors.classifier import InelasticClassifier
from rattle.models.model import Array, Capability, GearFunctions, Model, Range
from rattle.orbits.iterates import StatesAfterReturn
from rattle.orbits.orbits_a_to_d import PeriodOne
from rattle.parameters import Harmonic, Parameters, read_declared_parameters

RESTITUTION, LOAD = read_declared_parameters(__file__)


def _relative_load_of_machine(load_torque: Any, pair: Any) -> Any:
    """Return the load: load torque on the second gear divided by drag torque, both referred to the first gear."""
    # at speed 0 the drag torque is 0, and np.divide returns infinity where `/` of floats raises ZeroDivisionError
    return np.divide(load_torque * pair.radius_ratio, pair.drag * pair.speed)


@dataclass(frozen=True)
class Inelastic(Model):
    """The inelastic model.

    beta > 0: the half-backlash. restitution in (0, 1]: the coefficient of restitution.
    load ≥ 0: the load torque divided by the drag torque. harmonics: the harmonics of the forcing besides the first.
    """

    restitution: float = RESTITUTION.example
    load: float = 0.0
    harmonics: tuple[Harmonic, ...] = ()

    name = "inelastic"
    title = "inelastic impacts"
    added = (RESTITUTION, replace(LOAD, of_machine=_relative_load_of_machine))
    has = frozenset({Capability.BALANCE, Capability.INTENSITY, Capability.PERIOD_ONE, Capability.CONTACT_PHASES})
    functions: ClassVar[GearFunctions] = inelastic
    classifier: ClassVar[type[Classifier]] = InelasticClassifier
    curve_names = inelastic.NAMES
    tile_samples = 16_384
    design_gears = 256
    takes_harmonics = True
    capabilities_without_harmonics = frozenset({Capability.PERIOD_ONE})
    # eccentricities of two cells at δ = β = 0.6: the first has quiet motion and impacts, the second contact phases
    precompilation_epsilons = (0.1, 0.25)

    def __post_init__(self) -> None:
        """Check and convert all parameters."""
        gear = self.gear(1.0, 0.0)  # the constructor of a gear checks the parameters
        for name in ("beta", "restitution", "load", "harmonics"):
            object.__setattr__(self, name, getattr(gear, name))

    @property
    def numbers(self) -> dict[str, float]:
        """The values of β, restitution and load by name, without the harmonics, which are not single numbers."""
        return {"beta": self.beta, "restitution": self.restitution, "load": self.load}

    def gear(self, delta: float, epsilon: float) -> inelastic.InelasticGear:  # type: ignore[override]
        """Return the gear at one point. Methods for capabilities outside `has` are absent or raise RattleError."""
        return inelastic.InelasticGear(delta, epsilon, self.beta, self.restitution, self.load, self.harmonics)

    def parameters_at(self, delta: ArrayLike, epsilon: ArrayLike) -> Parameters:
        """Return the parameters of points; δ and ε are broadcast. Raises ParameterError."""
        return super().parameters_at(delta, epsilon).with_harmonics(self.harmonics)

    def period_one(self, delta: ArrayLike, epsilon: ArrayLike) -> PeriodOne:
        """Return the motions A to D. Raises RattleError if the forcing has harmonics."""
        if self.harmonics:
            raise RattleError(
                "A to D and their regions are computed for a forcing of one cosine only: leave out the harmonics"
            )
        return super().period_one(delta, epsilon)

    def trace(self, name: str, delta: Range, epsilon: Range) -> Curve:
        """Return the curve `name` in a window of δ and ε; with harmonics, RattleError unless it is "quiet_limit"."""
        return inelastic.trace(name, **self.numbers, harmonics=self.harmonics, delta=delta, epsilon=epsilon)

    def codimension_two(self) -> Sequence[CodimensionTwo]:
        """Return the codimension-two points; none are computed for a forcing with harmonics."""
        return () if self.harmonics else inelastic.codimension_two_points_at(self.beta, self.restitution, self.load)

    @classmethod
    def states_after_return(cls, parameters: Parameters, tau: Array, v: Array) -> StatesAfterReturn:
        """Return states (n,) after one return to Σ⁺, at parameters (n,)."""
        more: dict[str, Any] = {**parameters.others, "harmonics": parameters.harmonics}
        return StatesAfterReturn.from_iterates(
            inelastic.iterate_tangent(parameters.delta, parameters.epsilon, tau, v, 1, **more)
        )
