"""The interface of all models of the gear: `Model`, and the protocols of a gear and of its functions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.basins import Basins, StatePlane
from rattle.attractors.classify import BUDGET, Classifier
from rattle.attractors.measures import Uncertainty
from rattle.attractors.reached import ReachedAttractors
from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.attractors.table import Attractor, Attractors, attractors_of_samples
from rattle.continuation.bifurcation_diagram import Diagram
from rattle.continuation.curve_continuation import Curve
from rattle.errors import RattleError, require_number
from rattle.families.join import join_into_families
from rattle.impacting.bifurcations.codimension_two import CodimensionTwo
from rattle.intensity.balance import impulse_balance_errors
from rattle.intensity.intensity import Intensity
from rattle.intensity.motions import Motion
from rattle.intensity.spectrum import SpectralDensity, SpectralLines
from rattle.intensity.table import Intensities, intensities_of
from rattle.intensity.visit import Impacts
from rattle.orbits.iterates import Impact, Iterates, IteratesWithExponents, StatesAfterReturn, Trajectory
from rattle.orbits.orbits_a_to_d import MissingLimit, Orbit, PeriodOne
from rattle.orbits.periodic_motions import PeriodicMotion
from rattle.parameters import BETA, Parameter, Parameters

Range = tuple[float, float]
SAMPLE = SampleSpec()
Array = NDArray[np.float64]
Rows = tuple[Attractors, NDArray[np.bool_], NDArray[np.int64]]


class Capability(StrEnum):
    """A feature that not every model has. Its value begins the text of `rattle.models.missing_capability_error`."""

    CLOSED_FORM = "closed forms of A to D are"
    PERIOD_ONE = "the motions A to D and the regions that they make are"
    MARGIN = "the margin of quiet running is"
    GAMMA = "the grazing curve Γ is"
    CRISIS = "the boundary crisis is"
    CORNERS = "grazes of period-one motions, and the points where curves meet, are"
    BALANCE = "the balance of impulses is"
    INTENSITY = "the intensity of impacts is"
    FILLED_ORBITS = "orbits that are filled between computed cells are"
    BOUNDARIES = "an explanation of boundaries is"
    BIFURCATION_PROOFS = "a proof of a bifurcation is"
    PROOFS = "a proof of periodic motions is"
    CONTACT_PHASES = "contact phases are"
    SUM_RULE = "a sum of exponents that is −δ is"
    MANIFOLDS = "manifolds of saddles are"
    DIAGRAMS = "bifurcation diagrams are"
    DEPARTURES = "motions that begin inside the gap, as after a shock, are"


class AnalyticLimits(NamedTuple):
    """The eccentricities at which the motions of a gear change, at one damping.

    sn1: A and C are born in a saddle-node. flip: C loses stability in a flip (period doubling). quiet_limit: above it
    there is no quiet motion. missing: for each limit that is None, the reason.
    """

    sn1: float | None
    flip: float | None
    quiet_limit: float
    missing: tuple[MissingLimit, ...]


class AnyGear(Protocol):
    """A gear of any model at one parameter point. `rattle.Gear` documents all methods."""

    @property
    def delta(self) -> float:
        """Damping δ."""

    @property
    def epsilon(self) -> float:
        """Eccentricity ε."""

    @property
    def beta(self) -> float:
        """Half-backlash β."""

    @property
    def parameters(self) -> Parameters:
        """All parameters of the point."""

    @property
    def states(self) -> StatePlane:
        """The plane of states (τ, v), with the classifier that decides which attractor a state reaches."""

    @property
    def quiet_limit(self) -> float:
        """Eccentricity above which teeth cannot stay in contact."""

    @property
    def sn1(self) -> float | None:
        """Eccentricity of SN1; None if the gear does not compute it.

        If SN1 does not exist, some gears give None, and all other gears raise RattleError.
        """

    def region(self) -> int:
        """Return the number of the region, an index of `REGIONS`."""

    def orbits(self) -> tuple[Orbit, ...]:
        """Return the admissible motions A to D; some gears add other P(1,1,0), named "P", or return only these."""

    def orbit(self, tau: float, v: float, n_plus: int = 1) -> PeriodicMotion:
        """Return the periodic motion near the departure (τ, v) that repeats after n_plus impacts on Σ⁺."""

    def saddle(self, orbit: Orbit) -> PeriodicMotion:
        """Return an orbit of period one with the data for its manifolds; RattleError if the gear has no manifolds."""

    def impact(self, tau: float, v: float) -> Impact:
        """Return the next departure from Σ⁺ after a departure (τ, v), v > 0, with the tangent matrix."""

    def departure(self, phase: float, position: float, velocity: float) -> tuple[float, float]:
        """Return the first departure (τ, v) from Σ⁺ of a motion with this phase, Φ and Φ', or raise RattleError."""

    def iterate(self, tau: ArrayLike, v: ArrayLike, n: ArrayLike) -> Iterates:
        """Return the states that the departures (τ, v) lead to after n returns to Σ⁺."""

    def trajectory(self, tau: float, v: float, periods: float = 10.0, points: int = 2000) -> Trajectory:
        """Return the motion after the departure (τ, v), sampled in time."""

    def attractors(
        self, count: int = 256, v_max: SpeedLimit = None, seed: int = 0, budget: int = BUDGET
    ) -> tuple[Attractor, ...]:
        """Return the attractors that `count` initial conditions reach, then stable orbits that none of them reaches."""

    def basins(
        self,
        resolution: int | None = None,
        v_max: SpeedLimit = None,
        method: str = "cells",
        impacts: int = 16,
        tau: Range | None = None,
        v: Range | None = None,
    ) -> Basins:
        """Return the basins of attraction on a grid of states (τ, v)."""

    def reached(self, tau: ArrayLike, v: ArrayLike) -> ReachedAttractors:
        """Return the attractor that each state (τ, v) reaches."""

    def uncertainty(self, pairs: int | None = None, v_max: SpeedLimit = None, seed: int = 0) -> Uncertainty:
        """Return the uncertainty exponent of the basin boundary."""

    def intensity(self, motion: Motion, periods: float | None = None) -> Intensity:
        """Return the intensity of a motion: impacts, speeds and energy per forcing period."""

    def impacts(self, motion: Motion, periods: float | None = None) -> Impacts:
        """Return the impacts of a motion."""

    def spectrum(self, motion: Motion, highest: float = 32.0, resolution: int = 64) -> SpectralLines | SpectralDensity:
        """Return the order spectrum of the contact force of a motion."""

    def sound(
        self,
        motion: Motion,
        rpm: float,
        seconds: float = 5.0,
        rate: int = 44100,
        ring: float = 2000.0,
        decay: float = 0.005,
    ) -> Array:
        """Return the sound of a motion at `rpm` revolutions per minute, as a signal with `rate` values per second."""


class GearFunctions(Protocol):
    """The functions that the package of a gear model provides, for arrays of parameters.

    Each function except `stretch` and `describe` takes δ and ε, the name of a curve, or the ends of a segment of the
    (δ, ε) plane, and by keyword β and the gear's other parameters. `rattle.impacting` and `rattle.stiff` are such
    packages.
    """

    def period_one(self, *given: Any, **more: Any) -> PeriodOne:
        """Return the motions A to D."""

    def iterate_tangent(self, *given: Any, **more: Any) -> IteratesWithExponents:
        """Return the states after n returns to Σ⁺, with both Lyapunov exponents."""

    def becomes_quiet_late(self, *given: Any, **more: Any) -> NDArray[np.bool_]:
        """Return flags of points where a motion that becomes quiet makes so many impacts that it may look chaotic."""

    def stretch(self, *given: Any, **more: Any) -> Array:
        """Return sums over the impacts of chaotic motions (n,), as `rattle.intensity.table.Stretch` specifies."""

    def diagram(self, *given: Any, **more: Any) -> Diagram[Any, Any]:
        """Return the bifurcation diagram along a segment."""

    def describe(self, name: str) -> str:
        """Return a description, in words, of the curve with a given name."""

    def trace(self, *given: Any, **more: Any) -> Curve:
        """Return the bifurcation curve with a given name."""


@dataclass(frozen=True)
class Model(ABC):
    """A model of the gear, over the plane of δ and ε. The fields of an instance are its parameters besides δ and ε.

    Attributes
    ----------
    name, title : str
        The name of the model in requests, stores and files, and the name that a list of models shows.
    added : tuple of Parameter
        The parameters of the model besides δ, ε and β, in the order of the fields.
    has : frozenset of Capability
        The capabilities of the model.
    functions : module
        The package with the functions of the gear, such as `rattle.impacting`.
    classifier : type of Classifier
        The class that decides which attractor a sample reaches.
    curve_names : tuple of str
        The names of the model's bifurcation curves.
    tile_samples : int
        The number of initial conditions in a tile of default size. Such a tile takes some seconds.
    cell_milliseconds : float, optional
        The time that a cell takes, for a model in which this time hardly depends on the number of samples; None for
        other models.
    design_gears : int
        The number of random gears from which the explorer estimates the yield at a point.
    diagram_steps : int
        The number of intervals of the parameter in the explorer's diagram through a point.
    takes_harmonics : bool
        True if the forcing may have harmonics besides the first.
    capabilities_without_harmonics : frozenset of Capability
        The capabilities that the model has only if the forcing has no harmonics besides the first.
    precompilation_epsilons : tuple of float
        Eccentricities of cells at δ = β = 0.6. Computing these cells compiles all kernels of the model.
    """

    beta: float = 0.6

    name: ClassVar[str]
    title: ClassVar[str]
    added: ClassVar[tuple[Parameter, ...]] = ()
    has: ClassVar[frozenset[Capability]] = frozenset()
    functions: ClassVar[GearFunctions]
    classifier: ClassVar[type[Classifier]]
    curve_names: ClassVar[Sequence[str]] = ()
    tile_samples: ClassVar[int] = 65_536
    cell_milliseconds: ClassVar[float | None] = None
    design_gears: ClassVar[int] = 1024
    diagram_steps: ClassVar[int] = 160
    takes_harmonics: ClassVar[bool] = False
    capabilities_without_harmonics: ClassVar[frozenset[Capability]] = frozenset()
    precompilation_epsilons: ClassVar[tuple[float, ...]] = (0.1,)

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        for name, value in self.numbers.items():
            object.__setattr__(self, name, require_number(name, value, positive=True))

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """Return the declarations of β and of the parameters that the model adds."""
        return (BETA, *cls.added)

    @property
    def numbers(self) -> dict[str, float]:
        """The values of β and of the parameters that the model adds, by name."""
        return asdict(self)

    def __str__(self) -> str:
        """Return β and the parameters that the model adds, with their values, as text."""
        return ", ".join(f"{each.long_name} = {self.numbers[each.name]:g}" for each in self.parameters())

    @property
    def contact_duration(self) -> float:
        """The duration of the contact of a fast impact, in forcing periods; 0 for rigid walls."""
        return 0.0

    @property
    def has_closed_forms(self) -> bool:
        """True if A to D have closed forms, so that these motions, regions and limits are computed immediately."""
        return Capability.CLOSED_FORM in self.has

    @abstractmethod
    def gear(self, delta: float, epsilon: float) -> AnyGear:
        """Return the gear at one point. Raises ParameterError."""

    def limits(self, delta: float) -> AnalyticLimits:
        """Return the eccentricities of SN1 and of the quiet limit at one damping.

        The flip of C is reported as missing; a subclass may compute it.

        Returns
        -------
        AnalyticLimits
            The limits. `missing` says why a limit is None.
        """
        gear = self.gear(delta, 0.0)
        unknown = f"not computed at one damping for the {self.name} model"
        flip = MissingLimit("flip", unknown, None)
        try:
            born = gear.sn1
        except RattleError as error:
            return AnalyticLimits(None, None, gear.quiet_limit, (MissingLimit("sn1", f"none: {error}", None), flip))
        if born is None:
            return AnalyticLimits(None, None, gear.quiet_limit, (MissingLimit("sn1", unknown, None), flip))
        return AnalyticLimits(born, None, gear.quiet_limit, (flip,))

    def codimension_two(self) -> Sequence[CodimensionTwo]:
        """Return the codimension-two points, where curves meet; none unless a subclass computes them."""
        return ()

    def parameters_at(self, delta: ArrayLike, epsilon: ArrayLike) -> Parameters:
        """Return the parameters of points; δ and ε are broadcast. Raises ParameterError."""
        return Parameters.from_values(self.name, delta, epsilon, **self.numbers)

    def grid(self, delta: Array, epsilon: Array) -> Parameters:
        """Return the parameters of the cells epsilon (m,) × delta (n,), row by row. Raises ParameterError."""
        return self.parameters_at(delta, epsilon[:, None]).flat()

    def period_one(self, delta: ArrayLike, epsilon: ArrayLike) -> PeriodOne:
        """Return the motions A to D, or the motions that correspond to them in this model."""
        return self.functions.period_one(delta, epsilon, **self.numbers)

    def attractors_of(self, delta: ArrayLike, epsilon: ArrayLike, sample: SampleSpec = SAMPLE) -> Attractors:
        """Return the attractors of all cells, as `rattle.attractors_of` does."""
        return attractors_of_samples(self.classifier, self.parameters_at(delta, epsilon), sample)

    def cells(self, delta: Array, epsilon: Array) -> Any:
        """Return the cells epsilon (m,) × delta (n,), row by row, as the constants that the kernels take."""
        return self.classifier.cells_of(self.grid(delta, epsilon))

    def cells_for_orbit_kernels(self, delta: Array, epsilon: Array) -> Any:
        """Return the constants of `cells` for kernels that follow only periodic orbits.

        A model may leave out constants that only the test for quiet motion needs, which saves time.

        Returns
        -------
        Any
            The cells epsilon (m,) × delta (n,), row by row.
        """
        return self.classifier.cells_for_orbit_kernels(self.grid(delta, epsilon))

    def impulse_balance_errors(self, delta: ArrayLike, epsilon: ArrayLike, table: Attractors) -> Array:
        """Return the error |(P₊ − P₋)/(4πδT) − 1| of the balance of impulses, for the attractors of cells (n,).

        P₊ and P₋ are the sums of the impulses on Σ⁺ and on Σ⁻ during a time T. With a load 4πδ is replaced by
        4πδ(1 + load).

        Returns
        -------
        Array
            Relative errors, one for each row of the table; NaN for quiet and undecided attractors, and for motions that
            cannot be followed.
        """
        return impulse_balance_errors(table, self.classifier.cells_of(self.parameters_at(delta, epsilon).flat()))

    def intensities_of(self, delta: ArrayLike, epsilon: ArrayLike, table: Attractors) -> Intensities:
        """Return the intensity of each attractor in a table, which `attractors_of` made for the same δ and ε."""
        return intensities_of(
            table, self.classifier.cells_of(self.parameters_at(delta, epsilon).flat()), self.functions.stretch
        )

    def becomes_quiet_late(self, delta: ArrayLike, epsilon: ArrayLike) -> NDArray[np.bool_]:
        """Return flags of points where a motion that becomes quiet makes so many impacts that it may look chaotic."""
        at = self.parameters_at(delta, epsilon)
        flat = at.flat()
        return self.functions.becomes_quiet_late(flat.delta, flat.epsilon, **flat.others).reshape(at.shape)

    def diagram(self, start: ArrayLike, end: ArrayLike, steps: int = 400, count: int = 64) -> Diagram[Any, Any]:
        """Return the bifurcation diagram along the segment from the point start = (δ, ε) to the point end."""
        return self.functions.diagram(start, end, **self.numbers, steps=steps, count=count)

    def describe(self, name: str) -> str:
        """Return a description of what happens to motions on the curve `name`. Raises ParameterError."""
        return self.functions.describe(name)

    def trace(self, name: str, delta: Range, epsilon: Range) -> Curve:
        """Return a bifurcation curve in a window of δ and ε. Raises RattleError if it cannot be followed."""
        return self.functions.trace(name, **self.numbers, delta=delta, epsilon=epsilon)

    @classmethod
    def classify_states(cls, parameters: Parameters, tau: Array, v: Array, budget: int = BUDGET) -> Classifier:
        """Return a classifier that has followed states (n, k) in n cells to attractors or to the end of the budget."""
        return cls.classifier.classify(parameters, tau, v, budget)

    @classmethod
    def states_after_return(cls, parameters: Parameters, tau: Array, v: Array) -> StatesAfterReturn:
        """Return states (n,) after one return to Σ⁺, at parameters (n,)."""
        delta, epsilon = parameters.delta, parameters.epsilon
        return StatesAfterReturn.from_iterates(
            cls.functions.iterate_tangent(delta, epsilon, tau, v, 1, **parameters.others)
        )

    @classmethod
    def join_row_of_cells(cls, parameters: Parameters, table: Attractors) -> Rows:
        """Join the attractors of n cells into families, with the cells as the one row of a grid.

        parameters (n,): the parameters of the cells, in the order of the row. table: the attractors of the cells.

        Returns
        -------
        Rows
            The result of `join_into_families`: the attractors, flags of continued orbits, and numbers of families.
        """
        return join_into_families(table, (1, parameters.size), cls.classifier.cells_of(parameters))
