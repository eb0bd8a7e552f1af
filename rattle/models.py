"""The two models of the gear over the (δ, ε) plane, with one interface; `model_of` gives the one that is meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle import curves, stiff
from rattle.attractors.classify import BUDGET, Classifier
from rattle.attractors.speeds import SpeedLimit
from rattle.attractors.table import Attractors
from rattle.continuation.diagram import Diagram
from rattle.curves import CodimensionTwo, Curve
from rattle.errors import RattleError, parameters, require_number
from rattle.families.join import joined_rows
from rattle.impacting.attractors.classifier import attractors_of, cells_of, classify
from rattle.impacting.attractors.families import plane
from rattle.impacting.attractors.stretch import stretch
from rattle.impacting.bifurcations.branches import Branch
from rattle.impacting.bifurcations.diagram import diagram
from rattle.impacting.bifurcations.events import Event
from rattle.impacting.gear import Gear
from rattle.impacting.map.iterate import iterate_tangent
from rattle.impacting.map.quiet import rests_late
from rattle.impacting.orbits.period_one import missing_limits, period_one
from rattle.intensity.balance import impulse_balance_errors
from rattle.intensity.table import Intensities, intensities_of, one_by_one
from rattle.orbits.iterates import Returned
from rattle.orbits.period_one import MissingLimit, PeriodOne
from rattle.stiff.attractors.classifier import cells_of as stiff_cells_of
from rattle.stiff.attractors.classifier import classify as stiff_classify
from rattle.stiff.attractors.families import plane as stiff_plane

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


@dataclass(frozen=True)
class Impacting:
    """The impacting model at half-backlash beta > 0. The methods are the functions of `rattle` of the same names."""

    beta: float = 0.6

    name = Model.IMPACTING
    curve_names = curves.NAMES
    in_closed_form = True  # A to D, and the regions and limits that follow from them
    has_margin = True  # `boundary_distance`
    has_gamma = True
    has_crisis = True
    has_corners = True  # `codimension_two`
    stiffness = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "beta", require_number("beta", self.beta, positive=True))

    def __str__(self) -> str:
        return f"half-backlash β = {self.beta:g}"

    def gear(self, delta: float, epsilon: float) -> Gear:
        """The model at one point."""
        return Gear(delta, epsilon, self.beta)

    def period_one(self, delta: ArrayLike, epsilon: ArrayLike) -> PeriodOne:
        """The motions A–D."""
        return period_one(delta, epsilon, self.beta)

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
        """The attractors of all cells."""
        return attractors_of(delta, epsilon, self.beta, count, v_max, seed, budget, tau, v_min)

    def cells(self, delta: NDArray[np.float64], epsilon: NDArray[np.float64]) -> Any:
        """The cells epsilon (m,) × delta (n,) as kernels take them, row by row."""
        return plane(delta, epsilon, self.beta)

    def cells_of_orbits(self, delta: NDArray[np.float64], epsilon: NDArray[np.float64]) -> Any:
        """The same where only periodic orbits are followed, which costs less."""
        return plane(delta, epsilon, self.beta, rests=False)

    def classified(self, columns: Columns, tau: NDArray[np.float64], v: NDArray[np.float64]) -> Classifier:
        """States (n, k) of cells with parameters (n,) δ, ε, β, each followed to its end."""
        delta, epsilon, beta = columns
        return classify(delta, epsilon, beta, tau, v)

    def returned(self, columns: Columns, tau: NDArray[np.float64], v: NDArray[np.float64]) -> Returned:
        """States (n,) after one return to Σ⁺, at parameters (n,)."""
        delta, epsilon, beta = columns
        return Returned.of(iterate_tangent(delta, epsilon, tau, v, 1, beta))

    def joined_rows(self, columns: Columns, table: Attractors) -> Rows:
        """The attractors of a row of cells with these parameters joined: see `rattle.families.join.joined_rows`."""
        return joined_rows(table, (1, columns[0].size), cells_of(*columns))

    def impulse_balance_errors(self, delta: ArrayLike, epsilon: ArrayLike, table: Attractors) -> NDArray[np.float64]:
        """|(Σv₊ − Σv₋)/(2πδT) − 1| of the attractors of cells (n,), NaN of quiet and undecided ones."""
        d, e, b = (np.array(x, order="C").ravel() for x in parameters(delta, epsilon, self.beta))
        return impulse_balance_errors(table, cells_of(d, e, b))

    def intensities_of(self, delta: ArrayLike, epsilon: ArrayLike, table: Attractors) -> Intensities:
        """How hard the attractors of cells rattle, which `attractors_of` found there: arrays (n,)."""
        d, e, b = (np.array(x, order="C").ravel() for x in parameters(delta, epsilon, self.beta))
        return intensities_of(table, cells_of(d, e, b), stretch)

    def rests_late(self, delta: ArrayLike, epsilon: ArrayLike) -> NDArray[np.bool_]:
        """Whether quiet motion takes too many impacts to be told from chaos."""
        d, e, b = parameters(delta, epsilon, self.beta)
        return rests_late(*(np.array(x, order="C").ravel() for x in (d, e, b))).reshape(d.shape)

    def diagram(self, start: ArrayLike, end: ArrayLike, steps: int = 400, count: int = 64) -> Diagram[Branch, Event]:
        """The bifurcation diagram from start to end, both (δ, ε)."""
        return diagram(start, end, self.beta, steps, count)

    def limits(self, delta: float) -> Limits:
        """SN1, flip and quiet limit at one damping."""
        gear = self.gear(delta, 0.0)
        return Limits(gear.sn1, gear.flip, gear.quiet_limit, missing_limits(gear.delta, gear.beta))

    def describe(self, name: str) -> str:
        """What happens on a curve. Raises ParameterError."""
        return curves.describe(name)

    def trace(self, name: str, delta: Range, epsilon: Range) -> Curve:
        """A bifurcation curve in a window. Raises ParameterError, and RattleError where it cannot be followed."""
        return curves.trace(name, self.beta, delta, epsilon)

    def codimension_two(self) -> Sequence[CodimensionTwo]:
        """The points where curves meet."""
        return curves.codimension_two(self.beta)


@dataclass(frozen=True)
class Stiff:
    """The model with walls of stiffness kappa > 0, at half-backlash beta > 0: the interface of `Impacting`, by the
    functions of `rattle.stiff`.
    """

    beta: float = 0.6
    kappa: float = 1e4

    name = Model.STIFF
    curve_names = stiff.NAMES
    in_closed_form = False
    has_margin = False
    has_gamma = False
    has_crisis = False
    has_corners = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "beta", require_number("beta", self.beta, positive=True))
        object.__setattr__(self, "kappa", require_number("kappa", self.kappa, positive=True))

    def __str__(self) -> str:
        return f"half-backlash β = {self.beta:g}, stiffness κ = {self.kappa:g}"

    @property
    def stiffness(self) -> float:
        """κ."""
        return self.kappa

    def gear(self, delta: float, epsilon: float) -> stiff.StiffGear:
        """The model at one point."""
        return stiff.StiffGear(delta, epsilon, self.beta, self.kappa)

    def period_one(self, delta: ArrayLike, epsilon: ArrayLike) -> PeriodOne:
        """The counterparts of A–D."""
        return stiff.period_one(delta, epsilon, self.beta, self.kappa)

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
        """The attractors of all cells."""
        return stiff.attractors_of(delta, epsilon, self.beta, self.kappa, count, v_max, seed, budget, tau, v_min)

    def cells(self, delta: NDArray[np.float64], epsilon: NDArray[np.float64]) -> Any:
        """The cells epsilon (m,) × delta (n,) as kernels take them, row by row."""
        return stiff_plane(delta, epsilon, self.beta, self.kappa)

    def cells_of_orbits(self, delta: NDArray[np.float64], epsilon: NDArray[np.float64]) -> Any:
        """The same."""
        return self.cells(delta, epsilon)

    def classified(self, columns: Columns, tau: NDArray[np.float64], v: NDArray[np.float64]) -> Classifier:
        """States (n, k) of cells with parameters (n,) δ, ε, β, κ."""
        delta, epsilon, beta, kappa = columns
        return stiff_classify(delta, epsilon, beta, kappa, tau, v)

    def returned(self, columns: Columns, tau: NDArray[np.float64], v: NDArray[np.float64]) -> Returned:
        """States (n,) after one return to Σ⁺, at parameters (n,)."""
        delta, epsilon, beta, kappa = columns
        return Returned.of(stiff.iterate_tangent(delta, epsilon, tau, v, 1, beta, kappa))

    def joined_rows(self, columns: Columns, table: Attractors) -> Rows:
        """The attractors of a row of cells with these parameters joined."""
        return joined_rows(table, (1, columns[0].size), stiff_cells_of(*columns))

    def impulse_balance_errors(self, delta: ArrayLike, epsilon: ArrayLike, table: Attractors) -> NDArray[np.float64]:
        """The same of contacts, whose impulses are those of the springs."""
        found = parameters(delta, epsilon, self.beta, kappa=self.kappa)
        d, e, b, k = (np.array(x, order="C").ravel() for x in found)
        return impulse_balance_errors(table, stiff_cells_of(d, e, b, k))

    def intensities_of(self, delta: ArrayLike, epsilon: ArrayLike, table: Attractors) -> Intensities:
        """How hard the attractors of cells rattle, which `attractors_of` found there: arrays (n,)."""
        found = parameters(delta, epsilon, self.beta, kappa=self.kappa)
        d, e, b, k = (np.array(x, order="C").ravel() for x in found)
        return intensities_of(table, stiff_cells_of(d, e, b, k), one_by_one)

    def rests_late(self, delta: ArrayLike, epsilon: ArrayLike) -> NDArray[np.bool_]:
        """Never: contact that does not end is seen when it begins."""
        return np.zeros(np.broadcast_shapes(np.shape(delta), np.shape(epsilon)), np.bool_)

    def diagram(
        self, start: ArrayLike, end: ArrayLike, steps: int = 400, count: int = 64
    ) -> Diagram[stiff.StiffBranch, stiff.StiffEvent]:
        """The bifurcation diagram from start to end, both (δ, ε)."""
        return stiff.diagram(start, end, self.beta, self.kappa, steps, count)

    def limits(self, delta: float) -> Limits:
        """SN1 and quiet limit at one damping."""
        gear = self.gear(delta, 0.0)
        flip = MissingLimit("flip", "not computed at one damping for stiff walls; the curve PDC has it", None)
        try:
            born = gear.sn1
        except RattleError as error:
            return Limits(None, None, gear.quiet_limit, (MissingLimit("sn1", f"none: {error}", None), flip))
        return Limits(born, None, gear.quiet_limit, (flip,))

    def describe(self, name: str) -> str:
        """What happens on a curve. Raises ParameterError."""
        return stiff.describe(name)

    def trace(self, name: str, delta: Range, epsilon: Range) -> Curve:
        """A bifurcation curve in a window. Raises ParameterError, and RattleError where it cannot be followed."""
        return stiff.trace(name, self.beta, self.kappa, delta, epsilon)

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
