"""Find the attractors of given states, and the other answers about states that both gears share."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.basins import Basins, Range, StatePlane, basins, classified
from rattle.attractors.classify import BUDGET, Classifier
from rattle.attractors.measures import Uncertainty, uncertainty
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import MOST_SAMPLES, SampleSpec, SpeedLimit
from rattle.attractors.table import Attractor, attractors_of_cell, of_samples
from rattle.errors import ParameterError, real_array, require, require_number
from rattle.orbits.iterates import fold
from rattle.orbits.period_one import HasOrbits, html_of_point
from rattle.parameters import Parameters


@dataclass(frozen=True)
class Reached:
    """The destinations of states.

    attractors: by falling share of the states. which: index into them, of the shape of the states. impacts: on Σ⁺ until
    the end of each was certain, −1 of chaotic and undecided ones.
    """

    attractors: tuple[Attractor, ...]
    which: NDArray[np.int64]
    impacts: NDArray[np.int64]


def states_of(tau: ArrayLike, v: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, ...]]:
    """Flat phases in [0, 1) and speeds above 0 of states that broadcast, and their shape. Raises ParameterError."""
    try:
        phases, speeds = np.broadcast_arrays(real_array("tau", tau), real_array("v", v))
    except ParameterError:
        raise
    except ValueError as error:
        raise ParameterError(f"tau and v must broadcast: {error}") from None
    require(phases.size > 0, "there must be a state at least")
    require(phases.size <= MOST_SAMPLES, f"{phases.size} states are too many at once: at most {MOST_SAMPLES}")
    require(bool(np.isfinite(phases).all()), "tau must be finite")
    require(bool((np.isfinite(speeds) & (speeds > 0.0)).all()), "v must be finite and greater than 0")
    return fold(phases.ravel()), speeds.astype(np.float64).ravel(), phases.shape


def reached(plane: StatePlane, tau: ArrayLike, v: ArrayLike) -> Reached:
    """Return what `rattle.Gear.reached` does, for the states of this plane."""
    phases, speeds, shape = states_of(tau, v)
    table, rows, impacts = classified(plane, phases, speeds)
    count = np.bincount(rows, minlength=table.kind.size)
    order = np.lexsort((np.arange(count.size), -count))
    number = np.argsort(order)
    found = attractors_of_cell(table.take(order), count[order])
    kind = table.kind[rows]
    impacts = np.where((kind == Outcome.CHAOTIC) | (kind == Outcome.UNDECIDED), -1, impacts)
    return Reached(found, number[rows].reshape(shape), impacts.reshape(shape))


class Sampled:
    """A gear at one parameter point, a frozen dataclass of its parameters δ, ε, β and what it has besides."""

    _classifier: ClassVar[type[Classifier]]
    _resolution: ClassVar[int]  # of basins, by default
    _pairs: ClassVar[int]  # for the uncertainty exponent, by default

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        for name, value in self._numbers.items():
            object.__setattr__(self, name, require_number(name, value, positive=name != "epsilon"))

    def _repr_html_(self: HasOrbits) -> str:
        return html_of_point(self)

    def attractors(
        self, count: int = 256, v_max: SpeedLimit = None, seed: int = 0, budget: int = BUDGET
    ) -> tuple[Attractor, ...]:
        """Return the attractors that a uniform low-discrepancy sample of (τ, v) ∈ [0, 1) × (0, v_max) finds.

        They come by falling fraction; then stable orbits that are known to exist and that no sample found, with
        fraction 0 and the upper bound of its interval.

        Quiet: captured by a proven-small bounce. Periodic: a stable fixed point of Π^k that the trajectory is seen to
        approach, with its exact label. Chaotic: neither within a watch of 1000 periods and 100 relaxation times 1/δ,
        and a first exponent above zero by its own error bar. Else undecided, as is what is left when a sample has made
        budget impacts on Σ⁺: small damping needs some 1000/δ. Deterministic in all arguments. Of the stiff gear quiet
        is a contact that never ends, labels P(m, n₊, n₋) count contacts, and above a stiffness of 1e8 or so a motion
        that becomes quiet may be left undecided: it needs some 10,000 returns. Raises ParameterError. What a label
        means, with its error: docs/decisions/0026-labels.md.

        Parameters
        ----------
        v_max : SpeedLimit
            A number, "natural" for 1.5 √(16πδβ) + 2πε, or None, which is 7 in the paper's plane (δ from 0.3 to 1.5, ε
            to 0.5, β from 0.2 to 1.2) and natural elsewhere.

        Returns
        -------
        tuple[Attractor, ...]
            Each with its fraction of the sample and a 95 % interval of it.
        """
        table = of_samples(self._classifier, self.parameters, SampleSpec(count, v_max, seed, budget))
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
        """Return the basins of attraction on resolution × resolution cells of (τ, v) ∈ [0, 1) × (0, v_max).

        As in Figures 4 and 6 of the paper, or of the box of these ranges (low, high) of tau and v. resolution: by
        default 1000, of the stiff gear 400.

        method "direct": each cell centre is followed as `attractors` follows its sample. "cells": simple cell mapping
        (Hsu 1987) of Π^impacts; a state that is certain to become quiet goes to a sink, one above v_max is followed
        until it returns or settles. "refined": cells, then directly every eighth cell along τ and v and wherever basins
        meet, until nothing changes. Only "direct" is sure to see a basin that is thin on the scale of a cell, and
        "refined" one of eight cells across (docs/decisions/0009-basins.md).

        Parameters
        ----------
        v_max : SpeedLimit
            A number, "natural" for 1.5 √(16πδβ) + 2πε, or None, which is 7 in the paper's plane and natural elsewhere.

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
        return basins(self.states, resolution, self._speed(v_max), method, impacts, tau, v)

    def reached(self, tau: ArrayLike, v: ArrayLike) -> Reached:
        """Return the attractors that states go to, distinguished as those of the sample in `attractors`.

        Tau and v broadcast; `rattle.sampled_states` makes states of a box or a density.

        Returns
        -------
        Reached
            `attractors`, by falling share of these states; `which`, the index of each state's attractor, and `impacts`,
            how many impacts it took until that was certain, both of the broadcast shape.

        Raises
        ------
        ParameterError
            If an argument is outside its domain.
        """
        return reached(self.states, tau, v)

    def uncertainty(self, pairs: int | None = None, v_max: SpeedLimit = None, seed: int = 0) -> Uncertainty:
        """Return the uncertainty exponent of the basin boundary in [0, 1) × (0, v_max), whose dimension is 2 less it.

        From exact trajectories: so many pairs of states at each of eight distances, from 2⁻⁶ of the plane down to 2⁻¹³,
        by default 8192, of the stiff gear 2048. v_max as in `basins`. Deterministic in all arguments. Raises
        ParameterError. Source: Grebogi, McDonald, Ott and Yorke, Physics Letters A 99 (1983) 415–418.

        Returns
        -------
        Uncertainty
            The exponent with its error, and the distances that it follows from.
        """
        return uncertainty(self.states, self._pairs if pairs is None else pairs, self._speed(v_max), seed)

    @property
    def states(self) -> StatePlane:
        """The plane of its states (τ, v)."""
        return StatePlane(self._classifier, self.parameters)

    @property
    def parameters(self) -> Parameters:
        """Return the parameters of this gear as arrays (1,)."""
        return Parameters.of(self._classifier.model, **{name: [value] for name, value in self._numbers.items()})

    @property
    def _numbers(self) -> dict[str, Any]:
        return asdict(self)  # type: ignore[call-overload]

    def _speed(self, v_max: SpeedLimit) -> float:
        return float(SampleSpec(v_max=v_max).highest(self.parameters)[0])
