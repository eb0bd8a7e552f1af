"""The classifier of the impacting gear, which computes the impact map in SIMD lanes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.ball import CaptureCentres
from rattle.attractors.classify import BUDGET, ROOM, Classifier, ProbeRecord
from rattle.attractors.recurrence import append_period_one_orbits
from rattle.attractors.samples import Trajectories
from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.attractors.table import AttractorTable, attractors_of_samples
from rattle.flight.forcing import Forcing
from rattle.impacting.attractors.balls import find_capture_radii_in_lanes
from rattle.impacting.attractors.settle import (
    CHUNK,
    LONG_CHUNK,
    ImpactingCells,
    follow_probes_in_lanes,
    follow_until_outcome,
)
from rattle.impacting.map.iterate import iterate, lane_block_of_thread
from rattle.impacting.map.quiet import capture_invariant_limit, capture_invariant_limits
from rattle.impacting.orbits.stable import find_stable_orbits
from rattle.parameters import Parameters


def make_elastic_cells(
    delta: NDArray[np.float64], epsilon: NDArray[np.float64], beta: NDArray[np.float64], quiet: NDArray[np.float64]
) -> ImpactingCells:
    """Return n cells with elastic impacts as the record that kernels take.

    quiet (n,): for each cell the largest v³/g at which a bounce with speed v and contact force g is certain to become
    quiet.

    Returns
    -------
    ImpactingCells
        The record.
    """
    return ImpactingCells(delta, epsilon, beta, quiet, np.ones_like(delta), np.zeros_like(delta))


def cells_of(parameters: Parameters) -> ImpactingCells:
    """Return the cells at these parameters (n,) as the record that kernels take."""
    delta, epsilon, beta = parameters.delta, parameters.epsilon, parameters.beta
    return make_elastic_cells(delta, epsilon, beta, capture_invariant_limits(delta, epsilon, beta))


def relative_force_amplitudes(cells: Any) -> NDArray[np.float64]:
    """Return, for each cell (n_cells,), the amplitude of the contact force divided by the force's mean."""
    with np.errstate(over="ignore"):  # the ratio overflows for a subnormal δ
        return np.asarray(Forcing(cells.epsilon).relative_force_amplitude(cells.delta))


def sort_by_roughness(
    which: NDArray[np.int64], samples: Trajectories, roughness: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Return the samples `which`, sorted by the roughness of their cells, the largest first.

    Samples that are followed together then mostly need the same method of search for their first impacts.
    roughness (n_cells,): the amplitude of each cell's contact force divided by the force's mean.

    Returns
    -------
    NDArray[np.int64]
        The same samples, in this order.
    """
    return which[np.argsort(-roughness[samples.cell[which]], kind="stable")]


def quiet_invariant(parameters: Parameters) -> float:
    """Return the largest v³/g at which a bounce is certain to become quiet, at the first of the parameter points.

    v is the speed of the bounce, and g the contact force at its impact.

    Returns
    -------
    float
        The limit of v³/g.
    """
    point = parameters.point()
    return capture_invariant_limit(point["delta"], point["epsilon"], point["beta"])


class ImpactingClassifier(Classifier):
    """Classifier of the samples of a block of cells of the impacting gear."""

    def __init__(self, cells: Any, tau: NDArray[np.float64], v: NDArray[np.float64], budget: int = BUDGET) -> None:
        """Prepare to classify the samples (tau, v), each (n_cells, count), of these cells.

        budget: the most impacts on Σ⁺ of a sample. The field `paths` (2,) counts flights whose first impact needs a
        scan, and flights whose first impact needs the slower safe search.
        """
        self.paths = np.zeros(2, np.int64)
        self._block = lane_block_of_thread()
        self._roughness = relative_force_amplitudes(cells)
        super().__init__(cells, tau, v, budget)

    model = "impacting"
    cells_of = staticmethod(cells_of)
    quiet_invariant = staticmethod(quiet_invariant)

    @classmethod
    def cells_for_orbit_kernels(cls, parameters: Parameters) -> ImpactingCells:
        """Return the record of cells without the limits for quiet motion, which are slow to compute."""
        return make_elastic_cells(parameters.delta, parameters.epsilon, parameters.beta, np.zeros(parameters.size))

    @staticmethod
    def states_after_returns(
        parameters: Parameters, tau: NDArray[np.float64], v: NDArray[np.float64], returns: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return τ and v after a number of returns to Σ⁺, and flags of states that become quiet.

        Returns
        -------
        tuple[ndarray, ndarray, ndarray]
            τ, v and the flags. All flags are False, because elastic bounces become ever lower but never end.
        """
        moved = iterate(parameters.delta, parameters.epsilon, tau, v, returns, parameters.beta)
        return moved.tau, moved.v, np.zeros(tau.size, np.bool_)

    @property
    def cell_has_quiet_motion(self) -> NDArray[np.bool_]:
        """Flags of the cells (n_cells,) that have a quiet motion."""
        return np.asarray(self.cells.quiet_invariant > 0)

    def add_known_orbits(self) -> None:
        """Add the stable orbits of period one, which are found without samples, to the tables of the cells."""
        delta, epsilon, beta = self.cells[:3]
        found = find_stable_orbits(delta, epsilon, beta, ROOM)
        most = int(found.n.max(initial=0))
        if most > ROOM:
            found = find_stable_orbits(delta, epsilon, beta, most)
            self.make_room_for_orbits(most)
        n, label, state = found.n, (found.n_plus, found.n_minus), (found.tau, found.v)
        append_period_one_orbits(n, *label, *state, found.trace, self.cells, self.orbits.to_kernel_tuple())
        self.grow_capture_regions()

    def find_capture_radii(self, centres: CaptureCentres) -> None:
        """Write to `centres.radius` the radii of the outer ellipses, which are twice those of the capture regions."""
        find_capture_radii_in_lanes(self._block, centres, self.cells)

    def advance(self, which: NDArray[np.int64], samples: Trajectories, early: bool) -> None:
        """Follow samples in lanes until each has an outcome or reaches its limit of impacts.

        early: attractors will soon capture most of the samples, so the lanes are checked more often.
        """
        flights = CHUNK if early else LONG_CHUNK
        which, tables = (
            sort_by_roughness(which, samples, self._roughness),
            (samples.to_kernel_tuple(), self.balls.to_kernel_tuple()),
        )
        follow_until_outcome(self._block, which, flights, self.cells, *tables, self.paths)

    def follow_with_tangent(
        self, which: NDArray[np.int64], least: NDArray[np.float64], periods: NDArray[np.float64], seen: ProbeRecord
    ) -> None:
        """Follow samples with a tangent vector (`Classifier.follow_with_tangent`), and write observations to `seen`."""
        tables = self.samples.to_kernel_tuple(), self.balls.to_kernel_tuple()
        follow_probes_in_lanes(
            self._block, which, least, periods, self.cells, *tables, seen.sums, seen.bitmaps, self.paths
        )


def attractors_of(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: ArrayLike = 0.6,
    count: int = 256,
    v_max: SpeedLimit = None,
    seed: int = 0,
    budget: int = BUDGET,
    tau: tuple[float, float] = (0.0, 1.0),
    v_min: float = 0.0,
) -> AttractorTable:
    """Return the attractors of many cells. delta, epsilon and beta broadcast, and cells are numbered in C order.

    The attractors of a cell equal those of `Gear.attractors` to the last bit, whatever the other cells are.

    Parameters
    ----------
    delta, epsilon, beta : array_like
        Damping, eccentricity and half-backlash of the cells, dimensionless.
    count, v_max, seed, budget
        The samples of each cell, as in `Gear.attractors`.
    tau, v_min
        The box from which samples are drawn: tau = (low, high), and v from v_min to v_max.

    Returns
    -------
    AttractorTable
        A row for each attractor of each cell, cell by cell.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    sample = SampleSpec(count, v_max, seed, budget, tau, v_min)
    return attractors_of_samples(
        ImpactingClassifier, Parameters.from_values(ImpactingClassifier.model, delta, epsilon, beta), sample
    )
