"""Classify the samples of cells of the stiff gear, by the stages of `rattle.attractors.classify`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.ball import CaptureCentres, find_capture_radii_one_by_one
from rattle.attractors.classify import BUDGET, Classifier, ProbeRecord
from rattle.attractors.samples import Trajectories
from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.attractors.table import AttractorTable, attractors_of_samples
from rattle.parameters import Parameters
from rattle.stiff.attractors.settle import StiffCells, follow_probes, follow_until_outcome
from rattle.stiff.map.iterate import apply_stiff_returns
from rattle.stiff.map.quiet import quiet_limit


def cells_of(parameters: Parameters) -> StiffCells:
    """Return cells with these parameters (n,) as the record `StiffCells`, for compiled code."""
    delta, epsilon, kappa = parameters.delta, parameters.epsilon, parameters.added["kappa"]
    rests = np.where(epsilon < quiet_limit(delta, kappa), 1.0, 0.0)
    return StiffCells(delta, epsilon, parameters.beta, rests, kappa)


class StiffClassifier(Classifier):
    """Classifier of the samples of a block of cells of the stiff gear."""

    model = "stiff"
    cells_of = staticmethod(cells_of)

    @staticmethod
    def states_after_returns(
        parameters: Parameters, tau: NDArray[np.float64], v: NDArray[np.float64], returns: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return states after a number of returns, and flags of quiet states: see `Classifier.states_after_returns`."""
        each = [np.full(tau.size, x) for x in parameters.values_by_name.values()]
        tau, v, quiet = tau.copy(), v.copy(), np.zeros(tau.size, np.int8)
        counts = (np.zeros(tau.size, np.int64) for _ in range(2))
        apply_stiff_returns(tau, v, np.full(tau.size, float(returns)), *each, quiet, *counts)
        return tau, v, quiet > 0

    @staticmethod
    def quiet_invariant(parameters: Parameters) -> float:  # noqa: ARG004
        """Return 0: v³/g alone does not decide whether a motion becomes quiet (`Classifier.quiet_invariant`)."""
        return 0.0

    @property
    def cell_has_quiet_motion(self) -> NDArray[np.bool_]:
        """The flags (n_cells,) of cells that have a quiet motion: permanent contact with Σ⁺ is possible."""
        return np.asarray(self.cells.cell_has_quiet_motion > 0)

    def add_known_orbits(self) -> None:
        """Do nothing, because this gear has no orbits that are known before its samples are followed."""

    def find_capture_radii(self, centres: CaptureCentres) -> None:
        """Find the radii of the capture regions around these centres, and write them to `centres.radius`."""
        find_capture_radii_one_by_one(centres, self.cells)

    def advance(self, which: NDArray[np.int64], samples: Trajectories, early: bool) -> None:  # noqa: ARG002
        """Follow the samples numbered `which` until each has an outcome or has made all returns that its limit allows.

        `early` has no effect: samples of this gear are checked for capture and recurrence at every return.
        """
        follow_until_outcome(which, self.cells, samples.to_kernel_tuple(), self.balls.to_kernel_tuple())

    def follow_with_tangent(
        self, which: NDArray[np.int64], least: NDArray[np.float64], periods: NDArray[np.float64], seen: ProbeRecord
    ) -> None:
        """Follow samples `which` with a tangent vector; write sums for exponents, and visited-cell bitmaps, to `seen`.

        Each sample is followed for at least `least` returns and `periods` forcing periods, unless its limit of returns
        comes first.
        """
        tables = self.samples.to_kernel_tuple(), self.balls.to_kernel_tuple()
        follow_probes(which, least, periods, self.cells, *tables, seen.sums, seen.bitmaps)


def attractors_of(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: ArrayLike,
    kappa: ArrayLike,
    count: int = 256,
    v_max: SpeedLimit = None,
    seed: int = 0,
    budget: int = BUDGET,
    tau: tuple[float, float] = (0.0, 1.0),
    v_min: float = 0.0,
) -> AttractorTable:
    """Return the attractors of many cells at once, as `rattle.attractors_of` does for the impacting gear.

    The parameters broadcast. A cell's attractors are to the last bit those that `StiffGear.attractors` returns; they do
    not depend on the other cells.

    Returns
    -------
    AttractorTable
        A row for each attractor of each cell, cell by cell.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    cells = Parameters.from_values(StiffClassifier.model, delta, epsilon, beta, kappa=kappa)
    return attractors_of_samples(StiffClassifier, cells, SampleSpec(count, v_max, seed, budget, tau, v_min))
