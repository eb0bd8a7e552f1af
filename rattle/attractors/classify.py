"""Classify the samples of many cells by attractor, with as few impacts as certainty allows.

Every sample is followed until an attractor captures it or it has made FIRST impacts. In a cell with unresolved samples,
a few of these, the probes, are then followed for longer with a tangent vector. The probes show whether the unresolved
samples are chaotic, or whether all unresolved samples must be followed for longer.

Unresolved samples count as chaotic only if their probes were followed for WATCH relaxation times 1/δ: phase space
contracts by e^(−δ) a period, and transients last a multiple of 1/δ. docs/labels.md describes the procedure;
docs/decisions/0007-survey-cost.md and 0026-labels.md give its reasons and measured errors.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.ball import BALLS_PER_ORBIT, CaptureCentres, append_capture_regions, centres_of_new_regions
from rattle.attractors.chaos import BATCHES, are_chaotic, count_unresolved, write_attractor_numbers
from rattle.attractors.recurrence import assign_orbits_to_recurrent_samples, mark_states_in_bitmaps
from rattle.attractors.samples import (
    GRID,
    Outcome,
    SampleSets,
    Trajectories,
    copy_with_double_capacity,
    create_orbit_tables,
)
from rattle.numerics.compile import compile_in_subprocess
from rattle.parameters import Parameters

PILOT = 8  # this many samples of a cell are followed first; orbits that they find can capture the other samples
FIRST, SECOND = 64, 512  # total impacts that a sample may make by the end of the first stage, and of the second stage
GROWTH = 4  # each later stage multiplies the total number of impacts that a sample may make by this factor
# Number of stages after the first at strong damping; a cell may get one more (FEW). At weak damping there are stages
# until the samples have used up their budget of impacts.
STAGES = 4
FEW = 8  # at strong damping a cell gets one more stage if at most one in FEW of its samples is unresolved
LEAST_PROBE_IMPACTS, PERIODS = 2000, 1000.0  # a probe is followed for at least this many impacts and forcing periods
CHATTERING = 0.5  # a sample that uses up its impacts in less than this share of the observation time may be chattering
# A probe is followed for at least this many relaxation times 1/δ. If they last longer than PERIODS forcing periods, all
# stages are longer in the same ratio.
WATCH = 100.0
# Damping below which the neighbour test has two rounds. Neighbours of a sample have the sample's phase, and speeds that
# are larger by multiples of NEIGHBOUR_STEP times the sample's speed.
WEAK, NEIGHBOUR_STEP = 0.3, 1e-9
# Numbers of states of a cell (its unresolved samples and their neighbours) that the neighbour test at weak damping has
# followed after its first and after its second round.
NEIGHBOUR_TEST_STATES = (256, 1024)
BUDGET = 1_000_000  # default budget of impacts of a sample; a sample that is still unresolved then is undecided
MOST_PROBE_IMPACTS = 20_000  # most impacts of a probe per PERIODS forcing periods; a faster probe stops early
# If cells have fewer samples than this, the neighbour test also follows neighbours of the samples, so that "chaotic" is
# as reliable as with this many samples.
ENOUGH_SAMPLES = 64
# Number of states (unresolved samples and their neighbours) of the neighbour test at strong damping, in a cell that has
# fewer than ENOUGH_SAMPLES samples and a quiet motion. In such a cell without a quiet motion the number is MOST_PROBES.
STATES_OF_SMALL_CELL = 256
# Largest number of probes of a cell. If samples leave a chaotic set after 3000 periods on average, at least one of this
# many probes leaves it in 98 % of cells.
MOST_PROBES = 12
TRACED_IMPACTS = 1000  # number of impacts during which every state is marked in a visited-cell bitmap
LONGER_BY = 4  # probes that seem to lie on several attractors are followed this many times as long
MOST_EXTENSIONS = 3  # an unclear exponent is measured again at most this often, each time for twice as long
ROOM = 8  # each cell has room for this many orbits at first; the room is doubled when a cell needs more


class ChaoticSet(NamedTuple):
    """A chaotic attractor of one cell.

    Attributes
    ----------
    samples : ndarray of int
        Numbers of the samples on the attractor.
    sums : ndarray, (k, BATCHES, 3)
        Time, ln stretch and ln|det| of each batch of flights, for the k samples whose exponents were measured.
    observation_time : float
        Observation time in forcing periods: the shortest among the samples that show the chaos.
    """

    samples: NDArray[np.int64]
    sums: NDArray[np.float64]
    observation_time: float


class ProbeRecord(NamedTuple):
    """Observations of k probes, in the form that kernels fill.

    `sums` (k, BATCHES, 3) holds the time, ln stretch and ln|det| of each batch of flights; `bitmaps` (k, GRID) holds
    the visited-cell bitmaps.
    """

    sums: NDArray[np.float64]
    bitmaps: NDArray[np.uint64]


class Classifier(ABC):
    """Classifier of the samples of a block of cells.

    The class holds the samples, the known orbits and the chaotic attractors of the cells. Subclasses implement how the
    states of a gear are followed.
    """

    model: ClassVar[str]  # the name of the gear's model, which selects the kernels
    #: Convert parameters (n,) to the record of cells that kernels take.
    cells_of: ClassVar[Callable[..., Any]]
    #: Return, at the first parameter point, the largest v³/g (speed v, contact force g) at which a bounce is certain to
    #: become quiet; 0 for a gear for which v³/g alone does not decide whether a bounce becomes quiet.
    quiet_invariant: ClassVar[Callable[..., float]]

    def __init__(self, cells: Any, tau: NDArray[np.float64], v: NDArray[np.float64], budget: int = BUDGET) -> None:
        """Take the record of cells for kernels, initial conditions (n_cells, count), and the budget of each sample."""
        n_cells, self.count = tau.shape
        self.cells, self.budget = cells, budget
        with np.errstate(over="ignore"):  # 1/δ of a subnormal δ is infinite
            # all stages of a cell are longer by this factor than at strong damping
            self.impact_limit_factor = np.maximum(1.0, WATCH / (PERIODS * self.area_contraction_rates(cells)))
        self.weak = self.area_contraction_rates(cells) < WEAK
        cell = np.repeat(np.arange(n_cells), self.count)
        self.samples = create_trajectories(cell, tau.ravel(), v.ravel(), self.impact_limit(FIRST, cell))
        self.orbits, self.balls = create_orbit_tables(n_cells, ROOM, BALLS_PER_ORBIT)
        self.n_orbits_with_capture_regions = np.zeros(
            n_cells, np.int64
        )  # number of the cell's orbits that have capture regions
        self.chaotic_sets: dict[int, list[ChaoticSet]] = {}
        self.stage = np.zeros(n_cells, np.int64)
        # cells whose probes all stayed unresolved but were not all chaotic; more measurements would not decide them
        self.unclear = np.zeros(n_cells, np.bool_)
        self.add_known_orbits()

    @staticmethod
    def area_contraction_rates(cells: Any) -> NDArray[np.float64]:
        """Return the rates (n_cells,) at which areas of (t, v²/2) shrink: δ per forcing period.

        Impacts that lose energy shrink areas too. For them a subclass returns the rate of motions with one impact per
        forcing period.

        Returns
        -------
        ndarray, (n_cells,)
            Rates per forcing period.
        """
        return np.asarray(cells.delta)

    @classmethod
    def cells_for_orbit_kernels(cls, parameters: Parameters) -> Any:
        """Return the record of cells for kernels that follow periodic orbits only."""
        return cls.cells_of(parameters)

    @staticmethod
    @abstractmethod
    def states_after_returns(
        parameters: Parameters, tau: NDArray[np.float64], v: NDArray[np.float64], returns: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return the states (k,) after a number of returns to Σ⁺, and flags (k,) of states that become quiet.

        The parameters are one point, or one for each state. A state that becomes quiet is returned as it was when this
        became certain, although its bounces go on.
        """

    @classmethod
    def classify(
        cls,
        parameters: Parameters,
        tau: NDArray[np.float64],
        v: NDArray[np.float64],
        budget: int = BUDGET,
    ) -> Self:
        """Follow each sample of n cells until it reaches an attractor or its budget ends.

        parameters: the parameters of the cells (n,). tau, v: the initial conditions (n, count).

        Returns
        -------
        Self
            The classifier, which holds the outcomes.
        """
        compile_in_subprocess(cls.model, "rattle.precompile:kernel_steps_for_surveys")
        found = cls(cls.cells_of(parameters), tau, v, budget)
        found.run_all_stages()
        return found

    @property
    @abstractmethod
    def cell_has_quiet_motion(self) -> NDArray[np.bool_]:
        """Flags of the cells (n_cells,) that have a quiet motion."""

    @abstractmethod
    def add_known_orbits(self) -> None:
        """Add the orbits that are known in closed form to the tables of the cells."""

    @abstractmethod
    def find_capture_radii(self, centres: CaptureCentres) -> None:
        """Reduce `centres.radius` to the largest tried radius at which the conditions hold around each centre."""

    @abstractmethod
    def advance(self, which: NDArray[np.int64], samples: Trajectories, early: bool) -> None:
        """Follow samples in place until each has reached an attractor or its limit of impacts, or has become recurrent.

        which: numbers of the samples. early: True in the first stage, in which attractors soon capture most samples; a
        subclass may then look for captured samples more often.
        """

    @abstractmethod
    def follow_with_tangent(
        self, which: NDArray[np.int64], least: NDArray[np.float64], periods: NDArray[np.float64], seen: ProbeRecord
    ) -> None:
        """Follow the samples `which` (k,) with a tangent vector, in place, and write the observations to `seen`.

        Each sample is followed for at least `least` impacts and `periods` forcing periods; both are arrays (k,).
        """

    def run_all_stages(self) -> None:
        """Follow each sample until it is on an attractor, has used up its budget, or its cell has had the last stage.

        In each stage the unresolved samples of a cell are followed up to a higher limit of impacts. At weak damping
        only the budget limits the number of stages.
        """
        index = np.arange(self.samples.cell.size).reshape(-1, self.count)
        pilot = np.zeros(self.count, np.bool_)
        pilot[np.arange(min(PILOT, self.count)) * self.count // min(PILOT, self.count)] = True
        self.follow_to_attractor_or_limit(index[:, pilot].ravel(), self.samples, early=True)
        self.follow_to_attractor_or_limit(index[:, ~pilot].ravel(), self.samples, early=True)
        pending = np.arange(len(index))
        while pending.size:
            left, leaks = count_unresolved(pending, self.status, self.impacts, FIRST * self.impact_limit_factor)
            some = left > 0
            pending, left, leaks = pending[some], left[some], leaks[some]
            leaks &= self.flag_cells_with_deferred_probes(pending)
            leaks |= (self.stage[pending] == 0) & (left < self.count) | self.unclear[pending]
            decided = np.zeros(pending.size, np.bool_)
            decided[~leaks] = self.judge_by_probes(pending[~leaks])
            few = (self.status[pending] == Outcome.UNRESOLVED).sum(axis=1) <= self.count // FEW
            decided |= (self.stage[pending] >= STAGES + few) & ~self.weak[pending]
            decided |= impact_limits_of_stages(self.stage[pending]) * self.impact_limit_factor[pending] >= self.budget
            pending = pending[~decided]
            self.run_next_stage(pending)

    def outcomes_of_states(
        self, cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], most: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the outcomes (k,) of states that are not samples, after at most `most` impacts.

        cell: the number of each state's cell. All arrays are (k,). A state that reaches no attractor within `most`
        impacts remains UNRESOLVED. Orbits that the states find are added to the tables of the cells.

        Returns
        -------
        NDArray[np.int64]
            `Outcome` of each state.
        """
        others = create_trajectories(cell, tau.copy(), v.copy(), most.copy())
        self.follow_to_attractor_or_limit(np.arange(cell.size), others)
        return np.asarray(others.status)

    def impact_limit(self, impacts: Any, cell: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the limit of impacts for samples of these cells, given the limit `impacts` at strong damping.

        If the damping is below WATCH/PERIODS, this limit is multiplied by WATCH/PERIODS over the damping.

        Returns
        -------
        NDArray[np.int64]
            The limits, at most the budget.
        """
        return np.minimum(impacts * self.impact_limit_factor[cell], self.budget).astype(np.int64)

    @property
    def status(self) -> NDArray[np.int64]:
        """`Outcome` of the samples, (n_cells, count)."""
        return np.asarray(self.samples.status.reshape(-1, self.count))

    @property
    def impacts(self) -> NDArray[np.int64]:
        """Impacts of the samples so far, (n_cells, count)."""
        return np.asarray(self.samples.impacts.reshape(-1, self.count))

    def select_unresolved(self, cells: NDArray[np.int64]) -> SampleSets:
        """Return the unresolved samples of these cells."""
        left = self.status[cells] == Outcome.UNRESOLVED
        row, column = np.nonzero(left)
        return SampleSets(cells[row] * self.count + column, left.sum(axis=1))

    def follow_to_attractor_or_limit(
        self, which: NDArray[np.int64], samples: Trajectories, early: bool = False
    ) -> None:
        """Follow samples in place until each has reached an attractor or its limit of impacts.

        which: numbers of the samples. early: True in the first stage (`advance`). When a sample becomes recurrent, its
        orbit is searched. If no orbit is found, the sample is followed further.
        """
        while which.size:
            self.advance(which, samples, early)
            which = which[samples.status[which] == Outcome.RECURRENT]
            self.resolve_recurrent_samples(which, samples)
            which = which[
                (samples.status[which] == Outcome.UNRESOLVED) & (samples.impacts[which] < samples.limit[which])
            ]

    def resolve_recurrent_samples(self, which: NDArray[np.int64], samples: Trajectories) -> None:
        """Find the orbits of recurrent samples, and the capture regions of these orbits.

        The tables of orbits are enlarged if a cell has no room for another orbit.
        """
        while which.size:
            which = assign_orbits_to_recurrent_samples(
                which, self.cells, samples, self.orbits, self.balls, self.n_orbits_with_capture_regions
            )
            self.grow_capture_regions()
            room = self.orbits.m.shape[1]
            if which.size and (self.orbits.n[samples.cell[which]] == room).any():
                self.make_room_for_orbits(2 * room)

    def grow_capture_regions(self) -> None:
        """Grow capture regions around points of the orbits that have no capture regions yet."""
        if (self.orbits.n == self.n_orbits_with_capture_regions).all():
            return
        centres = centres_of_new_regions(self.n_orbits_with_capture_regions, self.orbits, self.cells)
        self.find_capture_radii(centres)
        append_capture_regions(centres, self.balls.to_kernel_tuple())
        self.n_orbits_with_capture_regions[:] = self.orbits.n

    def make_room_for_orbits(self, most: int) -> None:
        """Double the room for orbits in each cell until each cell has room for at least `most` orbits."""
        while self.orbits.m.shape[1] < most:
            self.orbits, self.balls = copy_with_double_capacity(self.orbits), copy_with_double_capacity(self.balls)

    def run_next_stage(self, cells: NDArray[np.int64]) -> None:
        """Raise these cells' limit of impacts to that of the next stage; follow their unresolved samples up to it."""
        self.stage[cells] += 1
        which = self.select_unresolved(cells).sample_numbers
        cell = self.samples.cell[which]
        self.samples.limit[which] = self.impact_limit(impact_limits_of_stages(self.stage[cell]), cell)
        self.follow_to_attractor_or_limit(which[self.samples.impacts[which] < self.samples.limit[which]], self.samples)

    def judge_by_probes(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Measure probes in these cells, and return flags (k,) of the cells that are decided.

        A cell is decided if all its probes are chaotic. If the probes seem to lie on several attractors, the samples
        that `declare_chaos` then follows for longer must all be chaotic too. In a cell whose chaotic set may lose
        samples slowly to an attractor (`flag_cells_losing_samples`), all unresolved samples must also stay unresolved
        for as long as the probes.

        Returns
        -------
        NDArray[np.bool_]
            True where the unresolved samples are chaotic.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        chosen = self.select_unresolved(cells).select_evenly(MOST_PROBES)
        seen, chaotic = self.measure_exponents(chosen.sample_numbers)
        decided = chosen.cells_where_all(chaotic)
        all_unresolved = chosen.cells_where_all(self.samples.status[chosen.sample_numbers] == Outcome.UNRESOLVED)
        self.unclear[cells[~decided]] = all_unresolved[~decided]
        if not decided.all():
            every = np.repeat(decided, chosen.size)
            seen = ProbeRecord(seen.sums[every], seen.bitmaps[every])
        decided[decided] = self.declare_chaos(cells[decided], chosen.select_cells(decided), seen)
        doubtful = decided & self.flag_cells_losing_samples(cells)
        decided[doubtful] = self.check_if_samples_outlast_probes(cells[doubtful])
        return decided

    def flag_cells_losing_samples(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return flags (k,) of cells where a chaotic set may lose samples so slowly that the probes show no loss.

        Such losses are frequent at weak damping and in cells with a quiet motion. Cells with fewer samples than
        ENOUGH_SAMPLES are flagged too, because few samples may not show a loss.

        Returns
        -------
        NDArray[np.bool_]
            True for cells whose unresolved samples must all be followed (`check_if_samples_outlast_probes`).
        """
        return np.asarray(self.weak[cells] | self.cell_has_quiet_motion[cells] | (self.count < ENOUGH_SAMPLES))

    def flag_cells_with_deferred_probes(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return flags (k,) of the cells whose probes are not measured while samples still reach attractors.

        The probes of a flagged cell are measured as soon as `count_unresolved` expects that none of the cell's
        unresolved samples will reach an attractor. This method flags all cells; a subclass may leave some out.

        Returns
        -------
        NDArray[np.bool_]
            True for cells whose probes wait until no further samples are expected to reach an attractor.
        """
        return np.ones(cells.size, np.bool_)

    def check_if_samples_outlast_probes(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return flags (k,) of the cells where all unresolved samples stay unresolved for as long as the probes.

        Chaotic sets that lose samples slowly are frequent at weak damping and in cells with a quiet motion, and twelve
        probes do not reveal the loss. Therefore all unresolved samples of the cells are followed, for as many impacts
        as the probe with the most impacts. At weak damping, and if cells have fewer samples than ENOUGH_SAMPLES,
        neighbours of these samples are followed too (`flag_cells_with_unresolved_neighbours`). For a cell without a
        flag the chaotic sets that its probes had shown are removed from `chaos`.

        Returns
        -------
        NDArray[np.bool_]
            False for cells where a sample reaches an attractor or may be chattering, or where a neighbour does not
            stay unresolved.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        left, samples = self.select_unresolved(cells), self.samples
        which = left.sample_numbers
        samples.limit[which] = np.repeat(left.largest_by_cell(samples.impacts), left.size)
        self.follow_to_attractor_or_limit(which[samples.impacts[which] < samples.limit[which]], samples)
        cell = samples.cell[which]
        chattering = self.may_be_chattering(cell, samples.time[which], PERIODS * self.impact_limit_factor[cell])
        lasted = left.cells_where_all((samples.status[which] == Outcome.UNRESOLVED) & ~chattering)
        weak = self.weak[cells]
        for first, last in pairwise((0, *NEIGHBOUR_TEST_STATES)):
            crowd = lasted & weak
            lasted[crowd] = self.flag_cells_with_unresolved_neighbours(cells[crowd], first, last)
        if self.count < ENOUGH_SAMPLES:
            for cell_has_quiet_motion, states in ((True, STATES_OF_SMALL_CELL), (False, MOST_PROBES)):
                crowd = lasted & ~weak & (self.cell_has_quiet_motion[cells] == cell_has_quiet_motion)
                lasted[crowd] = self.flag_cells_with_unresolved_neighbours(cells[crowd], 0, states)
        for cell, all_left in zip(cells, lasted, strict=True):
            found = self.chaotic_sets.pop(int(cell))
            if all_left:
                self.chaotic_sets[int(cell)] = [
                    chaos._replace(observation_time=self.shortest_observation_time(chaos.samples)) for chaos in found
                ]
        return lasted

    def flag_cells_with_unresolved_neighbours(
        self, cells: NDArray[np.int64], first: int, last: int
    ) -> NDArray[np.bool_]:
        """Return flags of the cells where neighbours of the unresolved samples stay unresolved too (neighbour test).

        The states of a cell are numbered as in `neighbouring_trajectories`: first its unresolved samples, then their
        neighbours. The neighbours with numbers from `first` to `last` − 1 are tested. Each is followed for as many
        impacts as the unresolved sample of its cell with the most impacts. In chaos, neighbours soon become
        independent.

        Returns
        -------
        NDArray[np.bool_]
            Flags (k,). A cell has no flag if a tested neighbour does not stay unresolved or, except at weak damping,
            may be chattering.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        left, each = self.select_unresolved(cells), np.arange(first, last)
        others = self.neighbouring_trajectories(left, each, left.largest_by_cell(self.samples.impacts))
        # Only neighbours are followed. States with lower numbers than the neighbours of a cell are samples of the cell,
        # which are known to stay unresolved.
        fresh = (each >= left.size[:, None]).ravel()
        gone, others = np.zeros(fresh.size, np.bool_), others.take(fresh)
        self.follow_to_attractor_or_limit(np.arange(others.cell.size), others)
        # a neighbour that may be chattering fails the test, except at weak damping, where more neighbours are followed
        strong = ~self.weak[others.cell]
        chattering = self.may_be_chattering(others.cell, others.time, PERIODS * self.impact_limit_factor[others.cell])
        gone[fresh] = (others.status != Outcome.UNRESOLVED) | (strong & chattering)
        return ~np.asarray(gone.reshape(-1, each.size).any(axis=1))

    def neighbouring_trajectories(
        self, unresolved: SampleSets, number: NDArray[np.int64], most: NDArray[np.int64]
    ) -> Trajectories:
        """Return new trajectories from the unresolved samples of each cell, and from neighbours with larger speeds.

        Parameters
        ----------
        unresolved : SampleSets
            The unresolved samples of n cells.
        number : ndarray of int, (k,) or (n, k)
            Numbers of the states in a cell: the lowest numbers are the samples themselves, then come the first
            neighbours of all samples, then the second neighbours, and so on.
        most : ndarray of int, (n,)
            Impacts that a state of each cell may make.

        Returns
        -------
        Trajectories
            n·k states, cell by cell.
        """
        turn, place = np.divmod(number, unresolved.size[:, None])
        which, samples = unresolved.sample_numbers[unresolved.first_sample_index[:, None] + place].ravel(), self.samples
        v = samples.v[which] * (1.0 + NEIGHBOUR_STEP * turn.ravel())
        return create_trajectories(samples.cell[which], samples.tau[which], v, np.repeat(most, turn.shape[1]))

    def may_be_chattering(
        self, cell: NDArray[np.int64], time: NDArray[np.float64], periods: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return flags of samples that may be chattering towards quiet motion.

        A sample is flagged if its cell has a quiet motion and the sample used up its impacts in less than CHATTERING
        times the required observation time. time: the time that the impacts of the sample took. periods: the required
        observation time. Both are in forcing periods.

        Returns
        -------
        NDArray[np.bool_]
            True where a sample may be chattering.
        """
        return np.asarray(self.cell_has_quiet_motion[cell] & (time < CHATTERING * periods))

    def measure_exponents(self, which: NDArray[np.int64], factor: float = 1.0) -> tuple[ProbeRecord, NDArray[np.bool_]]:
        """Follow the samples `which` with a tangent vector, and for longer where the exponent is unclear.

        factor: each sample is followed for at least `factor` · PERIODS forcing periods, unless its limit of impacts
        comes first.

        Returns
        -------
        tuple[ProbeRecord, NDArray[np.bool_]]
            The observations, and flags of samples that are unresolved and chaotic.
        """
        seen, chaotic = allocate_probe_record(which.size), np.zeros(which.size, np.bool_)
        samples = self.samples
        pace = samples.time / np.maximum(samples.impacts, 1)
        todo = np.flatnonzero(samples.impacts[which] < self.budget)
        for extension in range(MOST_EXTENSIONS + 1):
            if not todo.size:
                break
            # samples with the most impacts per period need the most flights: start them first, so that all lanes end
            # at about the same time
            todo = todo[np.argsort(pace[which[todo]], kind="stable")]
            now = which[todo]
            longer = np.maximum(self.impact_limit_factor[samples.cell[now]], factor) * 2**extension
            most, room = MOST_PROBE_IMPACTS * longer, self.budget - samples.impacts[now]
            samples.limit[now] = samples.impacts[now] + np.minimum(most, room).astype(np.int64)
            part, before = allocate_probe_record(todo.size), samples.time[now]
            self.follow_with_tangent(
                now, np.full(todo.size, float(LEAST_PROBE_IMPACTS * 2**extension)), PERIODS * longer, part
            )
            self.resolve_recurrent_samples(now[samples.status[now] == Outcome.RECURRENT], samples)
            seen.sums[todo], seen.bitmaps[todo] = part
            left, time = samples.status[now] == Outcome.UNRESOLVED, samples.time[now] - before
            chattering = self.may_be_chattering(samples.cell[now], time, PERIODS * longer)
            # the exponent is not judged if the sample may be chattering, or if the sample used up its budget of impacts
            # before the required observation time
            stopped = chattering | (time < PERIODS * longer) & (room < most)
            chaotic[todo] = left & ~stopped & are_chaotic(part.sums)
            todo = todo[left & ~chaotic[todo] & ~stopped & (samples.impacts[now] < self.budget)]
        return seen, chaotic

    def declare_chaos(self, cells: NDArray[np.int64], probes: SampleSets, seen: ProbeRecord) -> NDArray[np.bool_]:
        """Declare the unresolved samples of these cells to be on the chaotic attractor on which their probes are.

        If the probes of a cell seem to lie on several attractors, the probes are followed for longer. If they still
        seem to lie on several, all unresolved samples of the cell are followed (`separate_chaotic_attractors`).

        seen: the observations of the probes.

        Returns
        -------
        NDArray[np.bool_]
            False for cells where some sample that was followed for longer was not found chaotic.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        declared = np.ones(cells.size, np.bool_)
        several = self.flag_cells_with_several_attractors(probes, seen.bitmaps)
        if several.any():
            some, each = probes.select_cells(several), np.repeat(several, probes.size)
            seen.bitmaps[each] = self.mark_states_of_next_impacts(some.sample_numbers, seen.bitmaps[each])
            several[several] = self.flag_cells_with_several_attractors(some, seen.bitmaps[each])
        if several.any():
            some, each = probes.select_cells(several), np.repeat(several, probes.size)
            more, chaotic = self.measure_exponents(some.sample_numbers, LONGER_BY)
            seen.sums[each] = more.sums
            seen.bitmaps[each] |= more.bitmaps
            declared[several] = some.cells_where_all(chaotic)
            several[several] = self.flag_cells_with_several_attractors(some, seen.bitmaps[each])
        single = declared & ~several
        left, one = self.select_unresolved(cells[single]).split_by_cell(), probes.select_cells(single)
        sums = np.split(seen.sums, probes.first_sample_index[1:])
        watched = one.smallest_by_cell(self.samples.time).tolist()
        for cell, all_left, i, least in zip(cells[single].tolist(), left, np.flatnonzero(single), watched, strict=True):
            self.chaotic_sets[cell] = [ChaoticSet(all_left, sums[i], least)]
        declared[several & declared] = self.separate_chaotic_attractors(cells[several & declared])
        return declared

    def separate_chaotic_attractors(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Follow all unresolved samples of these cells for longer, and group them by the chaotic attractor they are on.

        Samples whose visited-cell bitmaps overlap are on the same attractor, so a cell may have only one after all.

        Returns
        -------
        NDArray[np.bool_]
            False for cells where some sample was not found chaotic in the longer observation.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        left = self.select_unresolved(cells)
        (sums, prints), chaotic = self.measure_exponents(left.sample_numbers, LONGER_BY)
        declared = left.cells_where_all(chaotic)
        left, every = left.select_cells(declared), np.repeat(declared, left.size)
        sums, prints = sums[every], self.mark_states_of_next_impacts(left.sample_numbers, prints[every])
        number = np.zeros(left.sample_numbers.size, np.int64)
        write_attractor_numbers(prints, left.size, number)
        for cell, start, size in zip(cells[declared], left.first_sample_index, left.size, strict=True):
            span = np.arange(start, start + size)
            groups = [span[number[span] == i] for i in np.unique(number[span])]
            self.chaotic_sets[int(cell)] = [
                ChaoticSet(left.sample_numbers[i], sums[i], self.shortest_observation_time(left.sample_numbers[i]))
                for i in groups
            ]
        return declared

    def flag_cells_with_several_attractors(self, sets: SampleSets, prints: NDArray[np.uint64]) -> NDArray[np.bool_]:
        """Return flags of the cells whose samples' visited-cell bitmaps show several attractors.

        sets: the samples (k,) of each cell. prints (k, GRID): the bitmap of each sample.

        Returns
        -------
        NDArray[np.bool_], shape (number of cells in sets,)
            True if the bitmaps of the cell's samples show several attractors.
        """
        number = np.zeros(sets.sample_numbers.size, np.int64)
        write_attractor_numbers(prints.copy(), sets.size, number)
        return ~sets.cells_where_all(number == 0)

    def mark_states_of_next_impacts(self, which: NDArray[np.int64], prints: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Follow samples (k,) for TRACED_IMPACTS impacts, and mark the state after each impact in `prints` (k, GRID).

        Returns
        -------
        NDArray[np.uint64], shape (k, GRID)
            `prints`, the bitmaps of the samples, which are changed in place.
        """
        mark_states_in_bitmaps(which, TRACED_IMPACTS, self.cells, self.samples, prints)
        return prints

    def shortest_observation_time(self, which: NDArray[np.int64]) -> float:
        """Return the shortest time, in forcing periods, for which one of these samples was followed."""
        return float(self.samples.time[which].min())


def impact_limits_of_stages(stage: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the number of impacts that a sample may make from its start to the end of each stage, at strong damping.

    At weak damping the callers multiply this number by `impact_limit_factor`. stage (k,): numbers of stages, from 0.

    Returns
    -------
    NDArray[np.float64]
        Numbers of impacts (k,).
    """
    return np.where(stage == 0, float(FIRST), SECOND * float(GROWTH) ** (stage - 1))


def create_trajectories(
    cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], limit: NDArray[np.int64] | int
) -> Trajectories:
    """Return new trajectories (k,) with these states and limits of impacts. Kernels advance trajectories in place."""
    return Trajectories(
        cell=np.ascontiguousarray(cell),  # another memory layout would compile each kernel again
        tau=tau,
        v=v,
        limit=np.broadcast_to(limit, cell.shape).astype(np.int64),
        time=np.zeros(cell.size),
        **{name: np.zeros(cell.size, np.int64) for name in ("impacts", "status", "orbit", "gap", "pause")},
    )


def allocate_probe_record(count: int) -> ProbeRecord:
    """Return a record of zeros for the observations of `count` probes."""
    return ProbeRecord(np.zeros((count, BATCHES, 3)), np.zeros((count, GRID), np.uint64))
