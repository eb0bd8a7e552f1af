"""The inelastic model: impacts with a coefficient of restitution, a load, and a forcing of several harmonics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.typing import ArrayLike

from rattle import inelastic
from rattle.attractors.classify import Classifier
from rattle.inelastic.attractors.classifier import InelasticClassifier
from rattle.models.model import Array, Capability, Functions, Model
from rattle.orbits.iterates import Returned
from rattle.parameters import Harmonic, Parameters, parameters_in

RESTITUTION, LOAD = parameters_in(__file__)


@dataclass(frozen=True)
class Inelastic(Model):
    """The model at half-backlash beta > 0, restitution in (0, 1], load ≥ 0, with these harmonics beside the first."""

    restitution: float = RESTITUTION.example
    load: float = 0.0
    harmonics: tuple[Harmonic, ...] = ()

    name = "inelastic"
    title = "inelastic impacts"
    added = (RESTITUTION, LOAD)
    has = frozenset({Capability.BALANCE, Capability.INTENSITY, Capability.CONTACT_PHASES})
    functions: ClassVar[Functions] = inelastic
    classifier: ClassVar[type[Classifier]] = InelasticClassifier
    tile_samples = 16_384
    design_gears = 256
    takes_harmonics = True
    compiled_at = (0.1, 0.25)  # quiet motion beside impacts; contact phases

    def __post_init__(self) -> None:
        """Check and convert all numbers."""
        gear = self.gear(1.0, 0.0)  # checks the numbers
        for name in ("beta", "restitution", "load", "harmonics"):
            object.__setattr__(self, name, getattr(gear, name))

    @property
    def numbers(self) -> dict[str, float]:
        """β, and what the model has besides, by name; not its harmonics, which are no numbers."""
        return {"beta": self.beta, "restitution": self.restitution, "load": self.load}

    def gear(self, delta: float, epsilon: float) -> inelastic.InelasticGear:  # type: ignore[override]
        """Return the model at one point, without what `has` does not list."""
        return inelastic.InelasticGear(delta, epsilon, self.beta, self.restitution, self.load, self.harmonics)

    def at(self, delta: ArrayLike, epsilon: ArrayLike) -> Parameters:
        """Return the parameters of points, which broadcast. Raises ParameterError."""
        return super().at(delta, epsilon).with_harmonics(self.harmonics)

    @classmethod
    def returned(cls, parameters: Parameters, tau: Array, v: Array) -> Returned:
        """Return states (n,) after one return to Σ⁺, at parameters (n,)."""
        more: dict[str, Any] = {**parameters.others, "harmonics": parameters.harmonics}
        return Returned.of(inelastic.iterate_tangent(parameters.delta, parameters.epsilon, tau, v, 1, **more))
