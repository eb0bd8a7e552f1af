"""Find the attractors of samples of the inelastic gear, by the stages of `rattle.attractors.classify`.

Under forcing by one cosine and without load, samples are followed in SIMD lanes (`rattle.impacting.attractors.settle`),
otherwise one by one.

Where impacts lose energy, a chaotic set that comes close to contact finally loses all samples to contact. A contact
phase ends at a release, a zero of the contact force; all motions continue from a release along one trajectory, which
returns to contact.

The unresolved samples of a cell are therefore tested: PROBES states close to the samples make EXPOSURE impacts in
total. If none of these states becomes quiet or periodic, the samples are called chaotic. Otherwise the samples are
assigned to the attractors that the states reach. If such an attractor is an orbit without a contact phase, the samples
may be approaching it slowly, so they are first followed to the last stage.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.ball import CaptureCentres, find_capture_radii_one_by_one
from rattle.attractors.classify import BUDGET, STAGES, Classifier, ProbeRecord
from rattle.attractors.samples import CONTACT, Outcome, Trajectories
from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.attractors.table import AttractorTable, attractors_of_samples
from rattle.families.join import interpolate_cells
from rattle.impacting.attractors.classifier import relative_force_amplitudes, sort_by_roughness
from rattle.impacting.attractors.settle import CHUNK, LONG_CHUNK, ImpactingCells
from rattle.impacting.attractors.settle import follow_probes_in_lanes as measure_in_lanes
from rattle.impacting.attractors.settle import follow_until_outcome as settle_in_lanes
from rattle.impacting.map.iterate import lane_block_of_thread
from rattle.inelastic.attractors.settle import (
    ContactStates,
    count_contact_phases,
    find_orbits_of_contact_samples,
    follow_probes,
    follow_until_outcome,
)
from rattle.inelastic.given import Harmonics, check_harmonics, check_inelastic_parameters
from rattle.inelastic.map.cells import InelasticCells, cells_of_forcing_shape, make_inelastic_cells
from rattle.inelastic.map.harmonics import harmonics_at_unit_epsilon
from rattle.inelastic.map.iterate import apply_inelastic_returns
from rattle.parameters import Parameters

PROBES = 16  # number of states per cell that are followed to see whether they leave the chaotic set
# impacts that the PROBES states of a cell make in total in the cell's first test; if none of the states leaves the
# chaotic set, the cell may be called chaotic
EXPOSURE = 2**18


def cells_of(parameters: Parameters) -> InelasticCells:
    """Return cells with these parameters (n,) as the record `InelasticCells`, for compiled code."""
    added = parameters.added["restitution"], parameters.added["load"]
    return make_inelastic_cells(parameters.delta, parameters.epsilon, parameters.beta, *added, parameters.harmonics)


@interpolate_cells.register
def _(
    cells: InelasticCells, here: NDArray[np.int64], there: NDArray[np.int64], share: NDArray[np.float64]
) -> InelasticCells:
    """Return cells between pairs of cells, by linear interpolation of their parameters.

    here, there: the numbers of both cells of each pair. share (k,): fractions of the way from cell `here` to `there`.

    Returns
    -------
    InelasticCells
        k cells for each pair.
    """
    given = (cells.delta, cells.epsilon, cells.beta, cells.restitution, cells.load)
    delta, epsilon, beta, restitution, load = (
        (x[here, None] * (1.0 - share) + x[there, None] * share).ravel() for x in given
    )
    return cells_of_forcing_shape(delta, epsilon, beta, restitution, load, cells.shape)


class InelasticClassifier(Classifier):
    """Classifier of the samples of a block of cells of the inelastic gear."""

    def __init__(
        self, cells: InelasticCells, tau: NDArray[np.float64], v: NDArray[np.float64], budget: int = BUDGET
    ) -> None:
        """Prepare the classifier, with an empty table of the states that follow contact phases (`ContactStates`)."""
        # a contact phase ends at a zero of the contact force, and this zero alone determines the next state on Σ⁺
        room = len(cells.delta), cells.zeros.shape[1]
        self.contact_states = ContactStates(
            np.zeros(room[0], np.int64), np.zeros(room), np.zeros(room), np.zeros(room, np.int64)
        )
        given = cells.delta, cells.epsilon, cells.beta, cells.quiet_invariant, cells.restitution, cells.capture
        self.lane_cells, self.block, self.paths = ImpactingCells(*given), lane_block_of_thread(), np.zeros(2, np.int64)
        self.roughness = relative_force_amplitudes(cells)
        self.is_lossy = cells.restitution < 1.0
        # multiple of EXPOSURE in each cell's next test; it doubles after a test in which a state left the chaotic set
        self.exposure_factors = np.ones(room[0], np.int64)
        self.fits_lanes = (cells.load == 0.0) & np.array_equal(cells.shape, harmonics_at_unit_epsilon(()))
        super().__init__(cells, tau, v, budget)

    model = "inelastic"
    cells_of = staticmethod(cells_of)

    @staticmethod
    def states_after_returns(
        parameters: Parameters, tau: NDArray[np.float64], v: NDArray[np.float64], returns: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return states after a number of returns, and flags of quiet states: see `Classifier.states_after_returns`."""
        cells, quiet = cells_of(parameters), np.zeros(tau.size, np.int8)
        tau, v, cell = tau.copy(), v.copy(), np.zeros(tau.size, np.int64)
        if parameters.size > 1:
            cell = np.arange(tau.size)
        counts = (np.zeros(tau.size, np.int64) for _ in range(3))
        apply_inelastic_returns(tau, v, np.full(tau.size, returns), cell, cells, quiet, *counts, np.zeros(tau.size))
        return tau, v, quiet > 0

    @staticmethod
    def quiet_invariant(parameters: Parameters) -> float:  # noqa: ARG004
        """Return 0: v³/g alone does not decide whether a motion becomes quiet (`Classifier.quiet_invariant`)."""
        return 0.0

    @property
    def cell_has_quiet_motion(self) -> NDArray[np.bool_]:
        """The flags (n_cells,) of cells that have a quiet motion: their contact force is positive at all phases."""
        return np.asarray((self.cells.zero_count == 0) & (self.cells.positive == 1))

    @staticmethod
    def area_contraction_rates(cells: InelasticCells) -> NDArray[np.float64]:
        """Return the rate δ − 2 ln r at which areas of states shrink if there is one impact per forcing period.

        Drag contributes δ, and each impact with restitution r contributes −2 ln r.

        Returns
        -------
        ndarray, (n_cells,)
            Rate per forcing period.
        """
        return np.asarray(cells.delta - 2.0 * np.log(cells.restitution))

    def flag_cells_losing_samples(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return flags (k,) of cells where a chaotic set may lose samples so slowly that the probes show no loss.

        The flags are those of the base class, except that a cell where impacts lose energy is flagged at weak damping
        only.

        Returns
        -------
        ndarray of bool, (k,)
            True for cells whose unresolved samples must all be followed.
        """
        return super().flag_cells_losing_samples(cells) & (~self.is_lossy[cells] | self.weak[cells])

    def flag_cells_with_deferred_probes(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return flags (k,) of the cells whose probes are not measured while samples still reach attractors.

        Returns
        -------
        ndarray of bool, (k,)
            True for cells with elastic impacts.
        """
        return ~self.is_lossy[cells]

    def judge_by_probes(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Measure probes; return flags (k,) of decided cells, which `check_escape_from_chaos` revises where r < 1."""
        decided = super().judge_by_probes(cells)
        lossy = self.is_lossy[cells] & (self.status[cells] == Outcome.UNRESOLVED).any(axis=1)
        decided[lossy] = self.check_escape_from_chaos(cells[lossy], decided[lossy])
        return decided

    def check_escape_from_chaos(self, cells: NDArray[np.int64], decided: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Follow PROBES states close to unresolved samples of each cell (k,), to see if they leave the chaotic set.

        If no state of a cell becomes quiet or periodic, the flag of the cell in `decided` (k,) stays as it is.
        Otherwise the cell is not chaotic, and its unresolved samples are assigned to the attractors that the states
        reach, in the same proportions. But if a state reaches an orbit without a contact phase before the last stage,
        nothing is assigned yet: the flag becomes False, and the samples of the cell are followed further.

        Returns
        -------
        ndarray of bool, (k,)
            `decided` after this test: True for cells that need no further stage.
        """
        if not cells.size:
            return decided
        left, samples = self.select_unresolved(cells), self.samples
        number, most = (
            left.size[:, None] + np.arange(PROBES),
            self.impact_limit(EXPOSURE // PROBES * self.exposure_factors[cells], cells),
        )
        others = self.neighbouring_trajectories(left, number, most)
        self.follow_to_attractor_or_limit(np.arange(others.cell.size), others)
        status, orbit = (x.reshape(-1, PROBES) for x in (others.status, others.orbit))
        ended = (status == Outcome.QUIET) | (status == Outcome.PERIODIC)
        slowly = ended & (status != Outcome.QUIET) & (others.pause != CONTACT).reshape(-1, PROBES)
        for i, each in enumerate(left.split_by_cell()):
            if not ended[i].any():
                continue
            self.chaotic_sets.pop(int(cells[i]), None)
            decided[i] = not slowly[i].any() or self.stage[cells[i]] >= STAGES
            if decided[i]:
                one = np.resize(np.flatnonzero(ended[i]), each.size)
                samples.status[each], samples.orbit[each] = status[i, one], orbit[i, one]
            self.exposure_factors[cells[i]] *= 2
        return decided

    def add_known_orbits(self) -> None:
        """Do nothing, because this gear has no orbits that are known before its samples are followed."""

    def grow_capture_regions(self) -> None:
        """Count the contact phases of new orbits, then grow their capture regions."""
        count_contact_phases(self.n_orbits_with_capture_regions, self.cells, self.orbits.to_kernel_tuple())
        super().grow_capture_regions()

    def resolve_recurrent_samples(self, which: NDArray[np.int64], samples: Trajectories) -> None:
        """Find the orbits of samples whose states recur.

        The orbit of a sample that has come out of a contact phase is found exactly, other orbits by Newton's method.
        """
        exact = samples.pause[which] == CONTACT
        waiting = which[exact]
        while waiting.size:
            left = np.zeros_like(waiting)
            tables = samples.to_kernel_tuple(), self.orbits.to_kernel_tuple(), self.balls.to_kernel_tuple()
            waiting = left[: find_orbits_of_contact_samples(waiting, self.cells, *tables, self.contact_states, left)]
            self.grow_capture_regions()
            if waiting.size:
                self.make_room_for_orbits(2 * self.orbits.m.shape[1])
        super().resolve_recurrent_samples(which[~exact], samples)

    def find_capture_radii(self, centres: CaptureCentres) -> None:
        """Write to `centres.radius` the radii of the outer ellipses, which are twice those of the capture regions."""
        find_capture_radii_one_by_one(centres, self.cells)

    def advance(self, which: NDArray[np.int64], samples: Trajectories, early: bool) -> None:
        """Follow samples `which` until each has an outcome or has made all impacts that its limit allows.

        early: whether attractors will soon capture most of these samples. Samples in SIMD lanes are then checked for
        capture more often.
        """
        in_lanes, tables = (
            self.fits_lanes[samples.cell[which]],
            (samples.to_kernel_tuple(), self.balls.to_kernel_tuple()),
        )
        some, flights = sort_by_roughness(which[in_lanes], samples, self.roughness), CHUNK if early else LONG_CHUNK
        settle_in_lanes(self.block, some, flights, self.lane_cells, *tables, self.paths)
        follow_until_outcome(which[~in_lanes], self.cells, *tables, self.contact_states)

    def follow_with_tangent(
        self, which: NDArray[np.int64], least: NDArray[np.float64], periods: NDArray[np.float64], seen: ProbeRecord
    ) -> None:
        """Follow samples `which` with a tangent vector; write sums for exponents, and visited-cell bitmaps, to `seen`.

        Sample which[j] is followed for at least least[j] impacts on Σ⁺ and periods[j] forcing periods, unless it has an
        outcome or reaches its limit of impacts before.
        """
        tables = self.samples.to_kernel_tuple(), self.balls.to_kernel_tuple()
        in_lanes = self.fits_lanes[self.samples.cell[which]]
        for some in (in_lanes, ~in_lanes):
            now, sums, prints = (which[some], least[some], periods[some]), seen.sums[some], seen.bitmaps[some]
            if some is in_lanes:
                measure_in_lanes(self.block, *now, self.lane_cells, *tables, sums, prints, self.paths)
            else:
                follow_probes(*now, self.cells, *tables, self.contact_states, sums, prints)
            seen.sums[some], seen.bitmaps[some] = sums, prints


def attractors_of(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: ArrayLike = 0.6,
    restitution: ArrayLike = 1.0,
    load: ArrayLike = 0.0,
    harmonics: Harmonics = (),
    count: int = 256,
    v_max: SpeedLimit = None,
    seed: int = 0,
    budget: int = BUDGET,
    tau: tuple[float, float] = (0.0, 1.0),
    v_min: float = 0.0,
) -> AttractorTable:
    """Return the attractors of many cells at once, as `rattle.attractors_of` does for elastic impacts.

    Parameters
    ----------
    delta, epsilon, beta, restitution, load : array_like
        The parameters of the cells, which broadcast: see `rattle.Gear`.
    harmonics : sequence of (int, float, float)
        The harmonics besides the first, the same for all cells: see `rattle.Gear`.
    count, v_max, seed, budget, tau, v_min
        The samples of each cell, as in `rattle.attractors_of`.

    Returns
    -------
    AttractorTable
        The attractors, cell by cell. The attractors of a cell do not depend on the other cells.

    Raises
    ------
    ParameterError
        If a parameter is outside its domain.
    """
    cells = check_inelastic_parameters(delta, epsilon, beta, restitution, load, check_harmonics(harmonics))
    return attractors_of_samples(InelasticClassifier, cells, SampleSpec(count, v_max, seed, budget, tau, v_min))
