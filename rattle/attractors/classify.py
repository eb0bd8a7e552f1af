"""Classify the samples of many cells by attractor, with as few impacts as certainty allows.

Every sample is followed until it is captured or has made FIRST impacts. In a cell with unresolved samples a few of
them, the probes, are then followed for longer with a tangent vector. The probes show whether the unresolved samples are
chaotic, or whether all unresolved samples must be followed for longer.

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

from rattle.attractors.ball import BALLS_PER_ORBIT, Centres, centres_of, enter_balls
from rattle.attractors.chaos import BATCHES, are_chaotic, group_numbers, standing
from rattle.attractors.recurrence import mark_footprints, resolve
from rattle.attractors.samples import GRID, Outcome, Sets, Trajectories, empty_tables, with_twice_the_room
from rattle.numerics.compile import compile_apart
from rattle.parameters import Parameters

PILOT = 8  # samples per cell that are followed first; the other samples use the orbits that these find
FIRST, SECOND = 64, 512  # impacts that a sample may make until the end of the first and of the second stage
GROWTH = 4  # each further stage lasts this many times as long as the previous one
STAGES = 4  # number of stages at strong damping; weak damping has as many as the budget allows
FEW = 8  # a cell where at most one sample in this many is unresolved gets one more stage
MEASURED, PERIODS = 2000, 1000.0  # least impacts and forcing periods for which a probe is followed
CHATTERING = 0.5  # a sample that uses up its impacts in less than this share of its periods may be chattering
# least relaxation times 1/δ for which a probe is followed; where this exceeds PERIODS, all stages are longer
WATCH = 100.0
# damping below which the neighbour test uses CROWDS, and relative difference in speed between a sample and a neighbour
WEAK, BESIDE = 0.3, 1e-9
CROWDS = (256, 1024)  # samples and neighbours of the neighbour test, in its first and its second round
BUDGET = 1_000_000  # default budget of impacts of a sample; a sample that is still unresolved then is undecided
MOST_MEASURED = 20_000  # most impacts of a probe that does not complete its periods
MANY = 64  # in a cell with fewer samples, their neighbours are followed too, so that "chaotic" is as reliable there
CROWD_OF_FEW = 256  # samples and neighbours of such a cell if it has a quiet motion, where slow losses are frequent
WITNESSES = 12  # probes per cell: if a chaotic set loses one sample in 3000 periods, 98 % of the cells show the loss
TRACED = 1000  # impacts over which every visited cell is recorded
LONGER = 4  # probes that seem to lie on different attractors are followed this many times as long
EXTENSIONS = 3  # most repetitions of the measurement of an unclear exponent, each over twice as many impacts
ROOM = 8  # initial room for orbits in each cell, doubled when a cell needs more


class Chaos(NamedTuple):
    """A chaotic attractor of one cell.

    Attributes
    ----------
    samples : ndarray of int
        Numbers of the samples on the attractor.
    sums : ndarray, (k, BATCHES, 3)
        Batch sums of the samples whose exponents were measured.
    watched : float
        Forcing periods for which the measured samples were followed.
    """

    samples: NDArray[np.int64]
    sums: NDArray[np.float64]
    watched: float


class Seen(NamedTuple):
    """Observations of k probes: batch sums (k, BATCHES, 3), visited-cell bitmaps (k, GRID)."""

    sums: NDArray[np.float64]
    prints: NDArray[np.uint64]


class Classifier(ABC):
    """Classify the samples of a block of cells.

    The class holds the samples, the known orbits and the chaotic attractors of the cells. Subclasses implement how the
    states of a gear are followed.
    """

    model: ClassVar[str]  # the gear's name, which selects its kernels
    #: Convert parameters (n,) to the record of cells that kernels take.
    cells_of: ClassVar[Callable[..., Any]]
    #: Return, at the first parameter point, the largest v³/g (speed v, contact force g) at which a bounce is certain to
    #: become quiet; 0 if the speed alone does not decide.
    quiet_invariant: ClassVar[Callable[..., float]]

    def __init__(self, cells: Any, tau: NDArray[np.float64], v: NDArray[np.float64], budget: int = BUDGET) -> None:
        """Take cells in the form of the kernels, initial conditions (n_cells, count), and the budget of each sample."""
        n_cells, self.count = tau.shape
        self.cells, self.budget = cells, budget
        with np.errstate(over="ignore"):  # 1/δ of a subnormal δ is infinite
            # factor by which all stages are longer than at strong damping
            self.longer = np.maximum(1.0, WATCH / (PERIODS * self.damping(cells)))
        self.weak = self.damping(cells) < WEAK
        cell = np.repeat(np.arange(n_cells), self.count)
        self.samples = begun(cell, tau.ravel(), v.ravel(), self.most(FIRST, cell))
        self.orbits, self.balls = empty_tables(n_cells, ROOM, BALLS_PER_ORBIT)
        self.grown = np.zeros(n_cells, np.int64)  # number of orbits with capture regions
        self.chaos: dict[int, list[Chaos]] = {}
        self.stage = np.zeros(n_cells, np.int64)
        # cells whose probes all stayed unresolved but were not all chaotic: measuring them again would not help
        self.unclear = np.zeros(n_cells, np.bool_)
        self.enter_known_orbits()

    @staticmethod
    def damping(cells: Any) -> NDArray[np.float64]:
        """Return the least contraction rate (n_cells,) of areas of states, per forcing period."""
        return np.asarray(cells.delta)

    @classmethod
    def cells_of_orbits(cls, parameters: Parameters) -> Any:
        """Return the record of cells for kernels that follow periodic orbits only."""
        return cls.cells_of(parameters)

    @staticmethod
    @abstractmethod
    def iterated(
        parameters: Parameters, tau: NDArray[np.float64], v: NDArray[np.float64], returns: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return the states (k,) after a number of returns, at one parameter point or k, and flags of quiet states.

        A state that becomes quiet is returned as it was when this became certain, although its bounces go on.
        """

    @classmethod
    def classify(
        cls,
        parameters: Parameters,
        tau: NDArray[np.float64],
        v: NDArray[np.float64],
        budget: int = BUDGET,
    ) -> Self:
        """Follow the samples (τ, v) (n, count) of cells with parameters (n,) to their attractors or their budget."""
        compile_apart(cls.model, "rattle.precompile:survey")
        found = cls(cls.cells_of(parameters), tau, v, budget)
        found.run()
        return found

    @property
    @abstractmethod
    def has_quiet(self) -> NDArray[np.bool_]:
        """Flags of the cells (n_cells,) that have a quiet motion."""

    @abstractmethod
    def enter_known_orbits(self) -> None:
        """Add the orbits that closed forms give to the tables of the cells."""

    @abstractmethod
    def enlarge(self, centres: Centres) -> None:
        """Find the radii of these capture regions, in place."""

    @abstractmethod
    def advance(self, which: NDArray[np.int64], samples: Trajectories, early: bool) -> None:
        """Follow these samples to their attractors or limits, in place. early: most of them will soon be captured."""

    @abstractmethod
    def watch(
        self, which: NDArray[np.int64], least: NDArray[np.float64], periods: NDArray[np.float64], seen: Seen
    ) -> None:
        """Follow these samples (k,) with a tangent vector, in place.

        Each is followed for at least `least` impacts and `periods` forcing periods, both (k,).
        """

    def run(self) -> None:
        """Follow every sample to its attractor or its budget."""
        index = np.arange(self.samples.cell.size).reshape(-1, self.count)
        pilot = np.zeros(self.count, np.bool_)
        pilot[np.arange(min(PILOT, self.count)) * self.count // min(PILOT, self.count)] = True
        self.settle(index[:, pilot].ravel(), self.samples, early=True)
        self.settle(index[:, ~pilot].ravel(), self.samples, early=True)
        pending = np.arange(len(index))
        while pending.size:
            left, leaks = standing(pending, self.status, self.impacts, FIRST * self.longer)
            some = left > 0
            pending, left, leaks = pending[some], left[some], leaks[some]
            leaks &= self.waits_for_leaks(pending)
            leaks |= (self.stage[pending] == 0) & (left < self.count) | self.unclear[pending]
            decided = np.zeros(pending.size, np.bool_)
            decided[~leaks] = self.judge(pending[~leaks])
            few = (self.status[pending] == Outcome.UNRESOLVED).sum(axis=1) <= self.count // FEW
            decided |= (self.stage[pending] >= STAGES + few) & ~self.weak[pending]
            decided |= impacts_until(self.stage[pending]) * self.longer[pending] >= self.budget
            pending = pending[~decided]
            self.extend(pending)

    def settled(
        self, cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], most: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Return the outcomes (k,) of other states of these cells after at most `most` impacts; all arrays are (k,).

        A state that reaches no attractor within `most` impacts remains UNRESOLVED. Orbits that the states find are
        added to the tables of the cells.

        Returns
        -------
        NDArray[np.int64]
            `Outcome` of each state.
        """
        others = begun(cell, tau.copy(), v.copy(), most.copy())
        self.settle(np.arange(cell.size), others)
        return np.asarray(others.status)

    def most(self, impacts: Any, cell: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return a limit of impacts for samples of these cells: more at weak damping, at most the budget."""
        return np.minimum(impacts * self.longer[cell], self.budget).astype(np.int64)

    @property
    def status(self) -> NDArray[np.int64]:
        """`Outcome` of the samples, (n_cells, count)."""
        return np.asarray(self.samples.status.reshape(-1, self.count))

    @property
    def impacts(self) -> NDArray[np.int64]:
        """Impacts of the samples so far, (n_cells, count)."""
        return np.asarray(self.samples.impacts.reshape(-1, self.count))

    def left_in(self, cells: NDArray[np.int64]) -> Sets:
        """Return the unresolved samples of these cells."""
        left = self.status[cells] == Outcome.UNRESOLVED
        row, column = np.nonzero(left)
        return Sets(cells[row] * self.count + column, left.sum(axis=1))

    def settle(self, which: NDArray[np.int64], samples: Trajectories, early: bool = False) -> None:
        """Follow samples to their limits. For a recurrent sample an orbit is searched, else it is followed further."""
        while which.size:
            self.advance(which, samples, early)
            which = which[samples.status[which] == Outcome.RECURRENT]
            self.resolve(which, samples)
            which = which[
                (samples.status[which] == Outcome.UNRESOLVED) & (samples.impacts[which] < samples.limit[which])
            ]

    def resolve(self, which: NDArray[np.int64], samples: Trajectories) -> None:
        """Find the orbits of recurrent samples and their capture regions, and enlarge the tables if a cell needs it."""
        while which.size:
            which = resolve(which, self.cells, samples, self.orbits, self.balls, self.grown)
            self.grow_balls()
            room = self.orbits.m.shape[1]
            if which.size and (self.orbits.n[samples.cell[which]] == room).any():
                self.make_room(2 * room)

    def grow_balls(self) -> None:
        """Grow capture regions around the points of orbits that have none yet."""
        if (self.orbits.n == self.grown).all():
            return
        centres = centres_of(self.grown, self.orbits, self.cells)
        self.enlarge(centres)
        enter_balls(centres, self.balls.for_kernels())
        self.grown[:] = self.orbits.n

    def make_room(self, most: int) -> None:
        """Double the room for orbits in each cell until each cell has room for at least `most` orbits."""
        while self.orbits.m.shape[1] < most:
            self.orbits, self.balls = with_twice_the_room(self.orbits), with_twice_the_room(self.balls)

    def extend(self, cells: NDArray[np.int64]) -> None:
        """Follow the unresolved samples of these cells through the next stage."""
        self.stage[cells] += 1
        which = self.left_in(cells).which
        cell = self.samples.cell[which]
        self.samples.limit[which] = self.most(impacts_until(self.stage[cell]), cell)
        self.settle(which[self.samples.impacts[which] < self.samples.limit[which]], self.samples)

    def judge(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Measure probes in these cells, and return flags (k,) of the cells that are decided.

        A cell is decided if all its probes are chaotic and, where samples may be lost slowly, all unresolved samples
        stay unresolved for as long as the probes.

        Returns
        -------
        NDArray[np.bool_]
            True where the unresolved samples are chaotic.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        chosen = self.left_in(cells).evenly(WITNESSES)
        seen, chaotic = self.measure(chosen.which)
        decided = chosen.all_of(chaotic)
        told_nothing = chosen.all_of(self.samples.status[chosen.which] == Outcome.UNRESOLVED)
        self.unclear[cells[~decided]] = told_nothing[~decided]
        if not decided.all():
            every = np.repeat(decided, chosen.size)
            seen = Seen(seen.sums[every], seen.prints[every])
        decided[decided] = self.declare_chaos(cells[decided], chosen.only(decided), seen)
        doubtful = decided & self.may_leak(cells)
        decided[doubtful] = self.outlast(cells[doubtful])
        return decided

    def may_leak(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return flags (k,) of cells where chaotic sets often lose samples slowly, so that probes miss the losses."""
        return np.asarray(self.weak[cells] | self.has_quiet[cells] | (self.count < MANY))

    def waits_for_leaks(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return flags (k,) of cells in which no probes are measured while other samples still settle."""
        return np.ones(cells.size, np.bool_)

    def outlast(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether all unresolved samples of these cells stay unresolved for as long as the longest probe.

        At weak damping, and in cells with a quiet motion, sets that lose samples slowly are frequent, and twelve probes
        do not reveal the loss. In these cells all unresolved samples are followed. At weak damping, and in cells with
        fewer samples than MANY, neighbours of these samples are followed too.

        Returns
        -------
        NDArray[np.bool_]
            True for cells where no sample and no neighbour reaches an attractor.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        left, samples = self.left_in(cells), self.samples
        which = left.which
        samples.limit[which] = np.repeat(left.largest(samples.impacts), left.size)
        self.settle(which[samples.impacts[which] < samples.limit[which]], samples)
        cell = samples.cell[which]
        chattering = self.may_rest(cell, samples.time[which], PERIODS * self.longer[cell])
        lasted = left.all_of((samples.status[which] == Outcome.UNRESOLVED) & ~chattering)
        weak = self.weak[cells]
        for first, last in pairwise((0, *CROWDS)):
            crowd = lasted & weak
            lasted[crowd] = self.crowd_lasts(cells[crowd], first, last)
        if self.count < MANY:
            for has_quiet, states in ((True, CROWD_OF_FEW), (False, WITNESSES)):
                crowd = lasted & ~weak & (self.has_quiet[cells] == has_quiet)
                lasted[crowd] = self.crowd_lasts(cells[crowd], 0, states)
        for cell, all_left in zip(cells, lasted, strict=True):
            found = self.chaos.pop(int(cell))
            if all_left:
                self.chaos[int(cell)] = [chaos._replace(watched=self.watched(chaos.samples)) for chaos in found]
        return lasted

    def crowd_lasts(self, cells: NDArray[np.int64], first: int, last: int) -> NDArray[np.bool_]:
        """Return whether neighbours of the unresolved samples of these cells stay unresolved too (neighbour test).

        first, last: the range of numbers of the followed states, as in `states_beside`. Each neighbour is followed for
        as many impacts as the unresolved sample with the most impacts. In chaos, neighbours soon become independent.

        Returns
        -------
        NDArray[np.bool_]
            Flags (k,) of the cells whose neighbours stay unresolved.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        left, each = self.left_in(cells), np.arange(first, last)
        others = self.states_beside(left, each, left.largest(self.samples.impacts))
        # flags of neighbours; lower numbers are the samples themselves, which need not be followed again
        fresh = (each >= left.size[:, None]).ravel()
        gone, others = np.zeros(fresh.size, np.bool_), others.take(fresh)
        self.settle(np.arange(others.cell.size), others)
        # at weak damping chattering neighbours are not sorted out, because more neighbours are followed there
        strong = ~self.weak[others.cell]
        chattering = self.may_rest(others.cell, others.time, PERIODS * self.longer[others.cell])
        gone[fresh] = (others.status != Outcome.UNRESOLVED) | (strong & chattering)
        return ~np.asarray(gone.reshape(-1, each.size).any(axis=1))

    def states_beside(self, left: Sets, number: NDArray[np.int64], most: NDArray[np.int64]) -> Trajectories:
        """Return new trajectories from the unresolved samples of each cell, and from neighbours with larger speeds.

        Parameters
        ----------
        left : Sets
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
        turn, place = np.divmod(number, left.size[:, None])
        which, samples = left.which[left.starts[:, None] + place].ravel(), self.samples
        v = samples.v[which] * (1.0 + BESIDE * turn.ravel())
        return begun(samples.cell[which], samples.tau[which], v, np.repeat(most, turn.shape[1]))

    def may_rest(
        self, cell: NDArray[np.int64], time: NDArray[np.float64], periods: NDArray[np.float64]
    ) -> NDArray[np.bool_]:
        """Return whether samples may be chattering: their impacts took only a fraction of the expected `periods`."""
        return np.asarray(self.has_quiet[cell] & (time < CHATTERING * periods))

    def measure(self, which: NDArray[np.int64], times: float = 1.0) -> tuple[Seen, NDArray[np.bool_]]:
        """Follow these samples with a tangent vector, and for longer where the exponent is unclear.

        times: the least factor by which the observation is longer than MEASURED impacts and PERIODS periods.

        Returns
        -------
        tuple[Seen, NDArray[np.bool_]]
            The observations, and flags of samples that are unresolved and chaotic.
        """
        seen, chaotic = nothing_seen(which.size), np.zeros(which.size, np.bool_)
        samples = self.samples
        pace = samples.time / np.maximum(samples.impacts, 1)
        todo = np.flatnonzero(samples.impacts[which] < self.budget)
        for extension in range(EXTENSIONS + 1):
            if not todo.size:
                break
            # start the slowest samples first, so that all lanes end together
            todo = todo[np.argsort(pace[which[todo]], kind="stable")]
            now = which[todo]
            longer = np.maximum(self.longer[samples.cell[now]], times) * 2**extension
            most, room = MOST_MEASURED * longer, self.budget - samples.impacts[now]
            samples.limit[now] = samples.impacts[now] + np.minimum(most, room).astype(np.int64)
            part, before = nothing_seen(todo.size), samples.time[now]
            self.watch(now, np.full(todo.size, float(MEASURED * 2**extension)), PERIODS * longer, part)
            self.resolve(now[samples.status[now] == Outcome.RECURRENT], samples)
            seen.sums[todo], seen.prints[todo] = part
            left, time = samples.status[now] == Outcome.UNRESOLVED, samples.time[now] - before
            chattering = self.may_rest(samples.cell[now], time, PERIODS * longer)
            stopped = chattering | (time < PERIODS * longer) & (room < most)  # stopped by the budget
            chaotic[todo] = left & ~stopped & are_chaotic(part.sums)
            todo = todo[left & ~chaotic[todo] & ~stopped & (samples.impacts[now] < self.budget)]
        return seen, chaotic

    def declare_chaos(self, cells: NDArray[np.int64], witnesses: Sets, seen: Seen) -> NDArray[np.bool_]:
        """Declare the unresolved samples of these cells to be on the chaotic attractor of the probes.

        If the probes of a cell seem to lie on several attractors, the probes are followed for longer, and if they still
        do, all unresolved samples of the cell are followed.

        Returns
        -------
        NDArray[np.bool_]
            False for cells where a sample turned out not to be chaotic.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        declared = np.ones(cells.size, np.bool_)
        several = self.are_several(witnesses, seen.prints)
        if several.any():
            some, each = witnesses.only(several), np.repeat(several, witnesses.size)
            seen.prints[each] = self.traced(some.which, seen.prints[each])
            several[several] = self.are_several(some, seen.prints[each])
        if several.any():
            some, each = witnesses.only(several), np.repeat(several, witnesses.size)
            more, chaotic = self.measure(some.which, LONGER)
            seen.sums[each] = more.sums
            seen.prints[each] |= more.prints
            declared[several] = some.all_of(chaotic)
            several[several] = self.are_several(some, seen.prints[each])
        single = declared & ~several
        left, one = self.left_in(cells[single]).each(), witnesses.only(single)
        sums = np.split(seen.sums, witnesses.starts[1:])
        watched = one.smallest(self.samples.time).tolist()
        for cell, all_left, i, least in zip(cells[single].tolist(), left, np.flatnonzero(single), watched, strict=True):
            self.chaos[cell] = [Chaos(all_left, sums[i], least)]
        declared[several & declared] = self.declare_several(cells[several & declared])
        return declared

    def declare_several(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Declare the unresolved samples of these cells to be on several chaotic attractors.

        Returns
        -------
        NDArray[np.bool_]
            False for cells where a sample turned out not to be chaotic.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        left = self.left_in(cells)
        (sums, prints), chaotic = self.measure(left.which, LONGER)
        declared = left.all_of(chaotic)
        left, every = left.only(declared), np.repeat(declared, left.size)
        sums, prints = sums[every], self.traced(left.which, prints[every])
        number = np.zeros(left.which.size, np.int64)
        group_numbers(prints, left.size, number)
        for cell, start, size in zip(cells[declared], left.starts, left.size, strict=True):
            span = np.arange(start, start + size)
            groups = [span[number[span] == i] for i in np.unique(number[span])]
            self.chaos[int(cell)] = [Chaos(left.which[i], sums[i], self.watched(left.which[i])) for i in groups]
        return declared

    def are_several(self, sets: Sets, prints: NDArray[np.uint64]) -> NDArray[np.bool_]:
        """Return whether the visited-cell bitmaps (k, GRID) of each cell's samples form several groups."""
        number = np.zeros(sets.which.size, np.int64)
        group_numbers(prints.copy(), sets.size, number)
        return ~sets.all_of(number == 0)

    def traced(self, which: NDArray[np.int64], prints: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Add the cells that the samples (k,) visit over TRACED more impacts to these bitmaps, and return them."""
        mark_footprints(which, TRACED, self.cells, self.samples, prints)
        return prints

    def watched(self, which: NDArray[np.int64]) -> float:
        """Return the least number of forcing periods for which any of these samples was followed."""
        return float(self.samples.time[which].min())


def impacts_until(stage: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the most impacts of a sample up to the end of each stage, at strong damping."""
    return np.where(stage == 0, float(FIRST), SECOND * float(GROWTH) ** (stage - 1))


def begun(
    cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], limit: NDArray[np.int64] | int
) -> Trajectories:
    """Return new trajectories (k,) with these states and limits of impacts. They are followed in place."""
    return Trajectories(
        cell=np.ascontiguousarray(cell),  # another memory layout would compile each kernel again
        tau=tau,
        v=v,
        limit=np.broadcast_to(limit, cell.shape).astype(np.int64),
        time=np.zeros(cell.size),
        **{name: np.zeros(cell.size, np.int64) for name in ("impacts", "status", "orbit", "gap", "pause")},
    )


def nothing_seen(count: int) -> Seen:
    """Return empty observations of `count` samples."""
    return Seen(np.zeros((count, BATCHES, 3)), np.zeros((count, GRID), np.uint64))
