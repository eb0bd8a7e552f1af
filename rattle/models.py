"""The two models of the gear over the (δ, ε) plane, with one interface; `model_of` gives the one that is meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle import curves, impacting, stiff
from rattle.attractors.classify import BUDGET, Classifier
from rattle.attractors.speeds import SpeedLimit
from rattle.attractors.table import Attractors, of_samples
from rattle.continuation.diagram import Diagram
from rattle.curves import CodimensionTwo, Curve
from rattle.errors import RattleError, parameters, require_number
from rattle.families.join import joined_rows
from rattle.impacting.attractors.classifier import ImpactingClassifier
from rattle.impacting.gear import Gear
from rattle.impacting.orbits.period_one import missing_limits
from rattle.intensity.balance import impulse_balance_errors
from rattle.intensity.table import Intensities, intensities_of
from rattle.orbits.iterates import Returned, Stretched
from rattle.orbits.period_one import MissingLimit, PeriodOne
from rattle.stiff.attractors.classifier import StiffClassifier

Range = tuple[float, float]
Columns = tuple[NDArray[np.float64], ...]
Rows = tuple[Attractors, NDArray[np.bool_], NDArray[np.int64]]


class Limits(NamedTuple):
    """Eccentricities at one damping: A and C are born, C flips, quiet motion ends; None where `missing` says why."""

    sn1: float | None
    flip: float | None
    quiet_limit: float
    missing: tuple[MissingLimit, ...]


class Model(StrEnum):
    """Which of the paper's models: walls that do not give way (2.3, 2.4), or elastic ones (2.1, 2.2)."""

    IMPACTING = "impacting"
    STIFF = "stiff"


class Functions(Protocol):
    """What a gear's package has, for arrays of parameters: each function takes δ and ε, or a curve's name or a segment,
    then β and what the gear has besides. `rattle.impacting` and `rattle.stiff` are such packages.
    """

    def period_one(self, *given: Any, **more: Any) -> PeriodOne: ...
    def iterate_tangent(self, *given: Any, **more: Any) -> Stretched: ...
    def rests_late(self, *given: Any, **more: Any) -> NDArray[np.bool_]: ...
    def stretch(self, *given: Any, **more: Any) -> NDArray[np.float64]: ...
    def diagram(self, *given: Any, **more: Any) -> Diagram[Any, Any]: ...
    def describe(self, name: str) -> str: ...
    def trace(self, *given: Any, **more: Any) -> Curve: ...


@dataclass(frozen=True)
class _EitherModel:
    """What both models answer, by the functions of their gear's package, which have the same names."""

    beta: float = 0.6

    functions: ClassVar[Functions]
    classifier: ClassVar[type[Classifier]]

    def __post_init__(self) -> None:
        for name, value in self.parameters.items():
            object.__setattr__(self, name, require_number(name, value, positive=True))

    @property
    def parameters(self) -> dict[str, float]:
        """β, and what the model has besides, by name."""
        return asdict(self)

    def period_one(self, delta: ArrayLike, epsilon: ArrayLike) -> PeriodOne:
        """The motions A–D, or their counterparts."""
        return self.functions.period_one(delta, epsilon, **self.parameters)

    def attractors_of(
        self,
        delta: ArrayLike,
        epsilon: ArrayLike,
        count: int = 256,
        v_max: SpeedLimit = None,
        seed: int = 0,
        budget: int = BUDGET,
        tau: Range = (0.0, 1.0),
        v_min: float = 0.0,
    ) -> Attractors:
        """The attractors of all cells: see `rattle.attractors_of`."""
        return of_samples(self.classifier, self._flat(delta, epsilon), count, v_max, seed, budget, tau, v_min)

    def cells(self, delta: NDArray[np.float64], epsilon: NDArray[np.float64]) -> Any:
        """The cells epsilon (m,) × delta (n,) as kernels take them, row by row."""
        return self.classifier.cells_of(*self._flat(delta, epsilon[:, None]))

    def cells_of_orbits(self, delta: NDArray[np.float64], epsilon: NDArray[np.float64]) -> Any:
        """The same where only periodic orbits are followed, which may cost less."""
        return self.classifier.cells_of_orbits(*self._flat(delta, epsilon[:, None]))

    def classified(self, columns: Columns, tau: NDArray[np.float64], v: NDArray[np.float64]) -> Classifier:
        """States (n, k) of cells with parameters (n,) δ, ε, β and so on, each followed to its end."""
        return self.classifier.classify(columns, tau, v)

    def returned(self, columns: Columns, tau: NDArray[np.float64], v: NDArray[np.float64]) -> Returned:
        """States (n,) after one return to Σ⁺, at parameters (n,)."""
        delta, epsilon, *others = columns
        return Returned.of(self.functions.iterate_tangent(delta, epsilon, tau, v, 1, *others))

    def joined_rows(self, columns: Columns, table: Attractors) -> Rows:
        """The attractors of a row of cells with these parameters joined: see `rattle.families.join.joined_rows`."""
        return joined_rows(table, (1, columns[0].size), self.classifier.cells_of(*columns))

    def impulse_balance_errors(self, delta: ArrayLike, epsilon: ArrayLike, table: Attractors) -> NDArray[np.float64]:
        """|(Σv₊ − Σv₋)/(2πδT) − 1| of the attractors of cells (n,), NaN of quiet and undecided ones; of contacts the
        impulses are those of the springs.
        """
        return impulse_balance_errors(table, self.classifier.cells_of(*self._flat(delta, epsilon)))

    def intensities_of(self, delta: ArrayLike, epsilon: ArrayLike, table: Attractors) -> Intensities:
        """How hard the attractors of cells rattle, which `attractors_of` found there: arrays (n,)."""
        return intensities_of(table, self.classifier.cells_of(*self._flat(delta, epsilon)), self.functions.stretch)

    def rests_late(self, delta: ArrayLike, epsilon: ArrayLike) -> NDArray[np.bool_]:
        """Whether quiet motion takes too many impacts to be told from chaos."""
        shape = np.broadcast_shapes(np.shape(delta), np.shape(epsilon))
        return self.functions.rests_late(*self._flat(delta, epsilon)).reshape(shape)

    def diagram(self, start: ArrayLike, end: ArrayLike, steps: int = 400, count: int = 64) -> Diagram[Any, Any]:
        """The bifurcation diagram from start to end, both (δ, ε)."""
        return self.functions.diagram(start, end, **self.parameters, steps=steps, count=count)

    def describe(self, name: str) -> str:
        """What happens on a curve. Raises ParameterError."""
        return self.functions.describe(name)

    def trace(self, name: str, delta: Range, epsilon: Range) -> Curve:
        """A bifurcation curve in a window. Raises ParameterError, and RattleError where it cannot be followed."""
        return self.functions.trace(name, **self.parameters, delta=delta, epsilon=epsilon)

    def _flat(self, delta: ArrayLike, epsilon: ArrayLike) -> list[NDArray[np.float64]]:
        """The parameters of cells, each (n,)."""
        return [np.array(x, order="C").ravel() for x in parameters(delta, epsilon, **self.parameters)]


@dataclass(frozen=True)
class Impacting(_EitherModel):
    """The impacting model at half-backlash beta > 0."""

    name = Model.IMPACTING
    functions: ClassVar[Functions] = impacting
    classifier = ImpactingClassifier
    curve_names = impacting.NAMES
    in_closed_form = True  # A to D, and the regions and limits that follow from them
    has_margin = True  # `boundary_distance`
    has_gamma = True
    has_crisis = True
    has_corners = True  # `codimension_two`
    stiffness = None

    def __str__(self) -> str:
        return f"half-backlash β = {self.beta:g}"

    def gear(self, delta: float, epsilon: float) -> Gear:
        """The model at one point."""
        return Gear(delta, epsilon, self.beta)

    def limits(self, delta: float) -> Limits:
        """SN1, flip and quiet limit at one damping."""
        gear = self.gear(delta, 0.0)
        return Limits(gear.sn1, gear.flip, gear.quiet_limit, missing_limits(gear.delta, gear.beta))

    def codimension_two(self) -> Sequence[CodimensionTwo]:
        """The points where curves meet."""
        return curves.codimension_two(self.beta)


@dataclass(frozen=True)
class Stiff(_EitherModel):
    """The model with walls of stiffness kappa > 0, at half-backlash beta > 0."""

    kappa: float = 1e4

    name = Model.STIFF
    functions: ClassVar[Functions] = stiff
    classifier = StiffClassifier
    curve_names = stiff.NAMES
    in_closed_form = False
    has_margin = False
    has_gamma = False
    has_crisis = False
    has_corners = False

    def __str__(self) -> str:
        return f"half-backlash β = {self.beta:g}, stiffness κ = {self.kappa:g}"

    @property
    def stiffness(self) -> float:
        """κ."""
        return self.kappa

    def gear(self, delta: float, epsilon: float) -> stiff.StiffGear:
        """The model at one point."""
        return stiff.StiffGear(delta, epsilon, self.beta, self.kappa)

    def limits(self, delta: float) -> Limits:
        """SN1 and quiet limit at one damping."""
        gear = self.gear(delta, 0.0)
        flip = MissingLimit("flip", "not computed at one damping for stiff walls; the curve PDC has it", None)
        try:
            born = gear.sn1
        except RattleError as error:
            return Limits(None, None, gear.quiet_limit, (MissingLimit("sn1", f"none: {error}", None), flip))
        return Limits(born, None, gear.quiet_limit, (flip,))

    def codimension_two(self) -> Sequence[CodimensionTwo]:
        """None are known: the corners that grazes make are smooth folds here."""
        return ()


AnyModel = Impacting | Stiff
AnyGear = Gear | stiff.StiffGear


def model_at(gear: AnyGear) -> AnyModel:
    """The model that a gear is one point of."""
    return Impacting(gear.beta) if isinstance(gear, Gear) else Stiff(gear.beta, gear.kappa)


def model_of(beta: float = 0.6, kappa: float | None = None) -> AnyModel:
    """The impacting model, or with a stiffness kappa the stiff one. Raises ParameterError."""
    return Impacting(beta) if kappa is None else Stiff(beta, kappa)
