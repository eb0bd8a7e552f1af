"""Base class of gears with the methods that follow states (τ, v): attractors, basins, uncertainty exponent."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.basins import Basins, Range, StatePlane, classify_plane_states, compute_basins
from rattle.attractors.classify import BUDGET, Classifier
from rattle.attractors.measures import Uncertainty, compute_uncertainty_exponent
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import MOST_SAMPLES, SampleSpec, SpeedLimit
from rattle.attractors.table import Attractor, attractors_of_cell, attractors_of_samples
from rattle.errors import ParameterError, require, require_number, require_real_array
from rattle.orbits.iterates import fold_phases
from rattle.orbits.orbits_a_to_d import GearWithOrbits, notebook_html_of_gear
from rattle.parameters import Parameters


@dataclass(frozen=True)
class ReachedAttractors:
    """The attractors that given states go to.

    Attributes
    ----------
    attractors : tuple of Attractor
        The attractors, ordered by falling share of the states.
    which : ndarray of int
        For each state the index of its attractor in `attractors`; it has the shape of the states.
    impacts : ndarray of int
        Impacts on Σ⁺ until the attractor of each state was certain; −1 for chaotic and undecided states.
    """

    attractors: tuple[Attractor, ...]
    which: NDArray[np.int64]
    impacts: NDArray[np.int64]


def check_and_flatten_states(
    tau: ArrayLike, v: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, ...]]:
    """Check and broadcast phases and speeds; return them as flat arrays, phases in [0, 1), with their common shape."""
    try:
        phases, speeds = np.broadcast_arrays(require_real_array("tau", tau), require_real_array("v", v))
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(f"the shapes of tau and v do not broadcast: {error}") from None
    require(phases.size > 0, "tau and v are empty: give at least one state")
    require(phases.size <= MOST_SAMPLES, f"{phases.size} states are too many at once: give at most {MOST_SAMPLES}")
    require(bool(np.isfinite(phases).all()), "tau must be finite")
    require(bool((np.isfinite(speeds) & (speeds > 0.0)).all()), "v must be finite and greater than 0")
    return fold_phases(phases.ravel()), speeds.astype(np.float64).ravel(), phases.shape


def find_reached_attractors(plane: StatePlane, tau: ArrayLike, v: ArrayLike) -> ReachedAttractors:
    """Return the attractors that given states of this plane go to; see `rattle.Gear.reached`."""
    phases, speeds, shape = check_and_flatten_states(tau, v)
    table, rows, impacts = classify_plane_states(plane, phases, speeds)
    count = np.bincount(rows, minlength=table.kind.size)
    order = np.lexsort((np.arange(count.size), -count))
    number = np.argsort(order)
    found = attractors_of_cell(table.take(order), count[order])
    kind = table.kind[rows]
    impacts = np.where((kind == Outcome.CHAOTIC) | (kind == Outcome.UNDECIDED), -1, impacts)
    return ReachedAttractors(found, number[rows].reshape(shape), impacts.reshape(shape))


class SampledGear:
    """Base class of gears at one parameter point, whose attractors and basins are found by following states.

    Subclasses are frozen dataclasses of δ, ε, β and further parameters.
    """

    _classifier: ClassVar[type[Classifier]]
    _resolution: ClassVar[int]  # default resolution of basins
    _pairs: ClassVar[int]  # default number of pairs for the uncertainty exponent

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        for name, value in self._parameter_values.items():
            object.__setattr__(self, name, require_number(name, value, positive=name != "epsilon"))

    def _repr_html_(self: GearWithOrbits) -> str:
        return notebook_html_of_gear(self)

    def attractors(
        self, count: int = 256, v_max: SpeedLimit = None, seed: int = 0, budget: int = BUDGET
    ) -> tuple[Attractor, ...]:
        """Return the attractors that a uniform low-discrepancy sample of (τ, v) ∈ [0, 1) × (0, v_max) finds.

        Attractors are ordered by falling fraction. Last come stable orbits that exist but that no sample reached; they
        have fraction 0, and an interval from 0 to its upper bound. The same arguments give the same result.

        Parameters
        ----------
        count : int
            Number of initial conditions.
        v_max : float, "natural" or None
            Largest sampled speed. "natural" is 1.5 √(16πδβ) + 2πε. None is 7 in the paper's plane (δ from 0.3 to 1.5, ε
            to 0.5, β from 0.2 to 1.2) and natural elsewhere.
        seed : int
            Seed of the sample.
        budget : int
            Impacts on Σ⁺ after which an unresolved sample is undecided. Small damping needs some 1000/δ.

        Returns
        -------
        tuple[Attractor, ...]
            Each attractor with its fraction of the sample and the 95 % interval of that fraction.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.

        Notes
        -----
        Kinds of attractors (docs/decisions/0026-labels.md has their errors):

        - quiet: a bounce so small that all later ones are certain to die out;
        - periodic: a stable fixed point of Π^k that the trajectory approaches, with its exact label;
        - chaotic: no attractor is reached within 1000 periods and 100 relaxation times 1/δ, and λ₁ exceeds its error
          bar;
        - undecided: all other samples.

        For the stiff gear quiet means permanent contact, and labels P(m, n₊, n₋) count contacts. Above a stiffness of
        about 1e8 a motion that becomes quiet needs some 10,000 returns and may remain undecided.
        """
        table = attractors_of_samples(self._classifier, self.parameters, SampleSpec(count, v_max, seed, budget))
        return attractors_of_cell(table, table.samples)

    def basins(
        self,
        resolution: int | None = None,
        v_max: SpeedLimit = None,
        method: str = "cells",
        impacts: int = 16,
        tau: Range = None,
        v: Range = None,
    ) -> Basins:
        """Return the basins of attraction on a grid of (τ, v), as in Figures 4 and 6 of the paper.

        Parameters
        ----------
        resolution : int, optional
            Cells along each axis; by default 1000, for the stiff and the inelastic gear 400.
        v_max : float, "natural" or None
            Largest speed of the grid. "natural" is 1.5 √(16πδβ) + 2πε. None is 7 in the paper's plane and natural
            elsewhere.
        method : {"direct", "cells", "refined"}
            "direct" follows each cell's centre as `attractors` follows its sample. "cells" is simple cell mapping (Hsu
            1987) of Π^impacts, where a state that is certain to become quiet goes to a sink, and a state above v_max is
            followed until it returns or reaches an attractor. "refined" adds to "cells" exact trajectories of every
            eighth cell along τ and v and of cells at basin boundaries, until no label changes. "direct" misses only
            parts of basins that hold no cell's centre; "refined" may also miss parts thinner than eight cells
            (docs/decisions/0009-basins.md).
        impacts : int
            Impacts on Σ⁺ in one step of the cell map. At damping below 0.3 a step has 0.3/δ times as many impacts.
        tau, v : tuple of float, optional
            Ranges (low, high) of the box; by default [0, 1) × (0, v_max).

        Returns
        -------
        Basins
            The attractors and the label of each cell.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        """
        resolution = self._resolution if resolution is None else resolution
        return compute_basins(self.states, resolution, self._highest_speed(v_max), method, impacts, tau, v)

    def reached(self, tau: ArrayLike, v: ArrayLike) -> ReachedAttractors:
        """Return the attractors that given states go to. Attractors are distinguished as in `attractors`.

        Parameters
        ----------
        tau, v : array_like
            Phases and speeds of the states, which broadcast. `rattle.sampled_states` draws states from a box or
            a density.

        Returns
        -------
        ReachedAttractors
            The attractors, ordered by falling share of these states; and for each state its attractor, and the impacts
            until this attractor was certain.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        """
        return find_reached_attractors(self.states, tau, v)

    def uncertainty(self, pairs: int | None = None, v_max: SpeedLimit = None, seed: int = 0) -> Uncertainty:
        """Return the uncertainty exponent of the basin boundary in [0, 1) × (0, v_max).

        The dimension of the boundary is 2 minus the exponent, which follows from exact trajectories of random pairs of
        states at each of eight distances, from 2⁻⁶ of the plane down to 2⁻¹³. The same arguments give the same result.

        Parameters
        ----------
        pairs : int, optional
            Pairs at each distance; by default 8192, for the stiff and the inelastic gear 2048.
        v_max : float, "natural" or None
            Largest speed, as in `basins`.
        seed : int
            Seed of the pairs.

        Returns
        -------
        Uncertainty
            The exponent with its error, and the distances and fractions from which it is computed.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.

        References
        ----------
        Grebogi, McDonald, Ott and Yorke, Physics Letters A 99 (1983) 415–418.
        """
        return compute_uncertainty_exponent(
            self.states, self._pairs if pairs is None else pairs, self._highest_speed(v_max), seed
        )

    @property
    def states(self) -> StatePlane:
        """Plane of the states (τ, v) of this gear."""
        return StatePlane(self._classifier, self.parameters)

    @property
    def parameters(self) -> Parameters:
        """The parameters of this gear, as arrays (1,)."""
        return Parameters.from_values(
            self._classifier.model, **{name: [value] for name, value in self._parameter_values.items()}
        )

    @property
    def _parameter_values(self) -> dict[str, Any]:
        return asdict(self)  # type: ignore[call-overload]  # each gear is a dataclass

    def _highest_speed(self, v_max: SpeedLimit) -> float:
        return float(SampleSpec(v_max=v_max).highest_speeds(self.parameters)[0])
