"""Classify the samples of many cells by attractor, with as few impacts as certainty allows.

Every sample is followed until it is captured or has made FIRST impacts. In a cell where some are left, a few of them,
the witnesses, are measured for longer with a tangent vector: they show what the others do, or that all must be followed
for longer. What is left is chaotic only if it was watched for WATCH relaxation times 1/δ: phase space contracts by
e^(−δ) a period, and a transient lasts some multiple of that. docs/decisions/0007-survey-cost.md and 0026-labels.md have
the reasons and the figures.
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

PILOT = 8  # samples per cell that look for its orbits first, so that the others need not find them again
FIRST, SECOND = 64, 512  # impacts that every sample may make before its cell is judged, and judged again
GROWTH = 4  # every further stage lasts this many times as long
STAGES = 4  # where damping is strong; else as many as the budget has room for
FEW = 8  # where no more than one in so many is left, there is one stage more
MEASURED, PERIODS = 2000, 1000.0  # least impacts and forcing periods of one witness
CHATTERING = 0.5  # of its periods: who makes so many impacts in less may be about to rest
WATCH = 100.0  # relaxation times 1/δ of one witness: below δ = 0.1 more than that, and all stages as much longer
WEAK, BESIDE = 0.3, 1e-9  # damping below which more states are watched, and how near to samples they are
CROWDS = (256, 1024)  # how many there are, at first and in the end
BUDGET = 1_000_000  # impacts of a sample, by default: what is left by then without being told is undecided
MOST_MEASURED = 20_000  # impacts of a witness that never gets through its periods
MANY = 64  # samples of a cell: where there are fewer, states beside them are watched too, to be as sure of chaos
CROWD_OF_FEW = 256  # of these states and samples where all may come to rest: MANY samples show losses that few do not
WITNESSES = 12  # per cell: if one in 3000 periods leaves a chaotic set, 98 % of the cells show it
TRACED = 1000  # impacts of a footprint without gaps
LONGER = 4  # witnesses that seem to be on different attractors are watched this many times as long
EXTENSIONS = 3  # an unclear exponent is measured again over twice the impacts, this many times
ROOM = 8  # orbits per cell to begin with; doubled where a cell has more


class Chaos(NamedTuple):
    """A chaotic attractor of one cell.

    The samples that are on it, the batch sums of those measured, and the forcing periods for which these were watched.
    """

    samples: NDArray[np.int64]
    sums: NDArray[np.float64]
    watched: float


class Seen(NamedTuple):
    """Observations of k probes: batch sums (k, BATCHES, 3), visited-cell bitmaps (k, GRID)."""

    sums: NDArray[np.float64]
    prints: NDArray[np.uint64]


class Classifier(ABC):
    """The samples of a block of cells on their way, and what is known of the cells; a gear says how they go on."""

    model: ClassVar[str]  # its name, which says what kernels it needs
    #: Cells with these parameters, all (n,), as kernels take them.
    cells_of: ClassVar[Callable[..., Any]]
    #: The largest v³/g that is certain to become quiet at the first of these points, 0 if speeds do not tell.
    quiet_invariant: ClassVar[Callable[..., float]]

    def __init__(self, cells: Any, tau: NDArray[np.float64], v: NDArray[np.float64], budget: int = BUDGET) -> None:
        """Take cells as the kernels do, initial conditions of shape (n_cells, count), and the most impacts of one."""
        n_cells, self.count = tau.shape
        self.cells, self.budget = cells, budget
        with np.errstate(over="ignore"):  # of a subnormal δ
            self.longer = np.maximum(1.0, WATCH / (PERIODS * self.damping(cells)))  # than where damping is strong
        self.weak = self.damping(cells) < WEAK
        cell = np.repeat(np.arange(n_cells), self.count)
        self.samples = begun(cell, tau.ravel(), v.ravel(), self.most(FIRST, cell))
        self.orbits, self.balls = empty_tables(n_cells, ROOM, BALLS_PER_ORBIT)
        self.grown = np.zeros(n_cells, np.int64)  # orbits whose balls are known
        self.chaos: dict[int, list[Chaos]] = {}
        self.stage = np.zeros(n_cells, np.int64)
        self.unclear = np.zeros(n_cells, np.bool_)  # witnesses told nothing: measuring again would not either
        self.enter_known_orbits()

    @staticmethod
    def damping(cells: Any) -> NDArray[np.float64]:
        """Return the rate (n_cells,) per forcing period at which areas of states shrink at least."""
        return np.asarray(cells.delta)

    @classmethod
    def cells_of_orbits(cls, parameters: Parameters) -> Any:
        """Return the same where only periodic orbits are followed."""
        return cls.cells_of(parameters)

    @staticmethod
    @abstractmethod
    def iterated(
        parameters: Parameters, tau: NDArray[np.float64], v: NDArray[np.float64], returns: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Return the states (k,) after `returns` returns, at one point or k of them, and whether they became quiet.

        One that goes on bouncing is located there.
        """

    @classmethod
    def classify(
        cls,
        parameters: Parameters,
        tau: NDArray[np.float64],
        v: NDArray[np.float64],
        budget: int = BUDGET,
    ) -> Self:
        """Return the samples (τ, v) (n, count) of cells with parameters (n,), followed to their end or budget."""
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
        """Enter into the tables what is known of the cells beforehand."""

    @abstractmethod
    def enlarge(self, centres: Centres) -> None:
        """Find the radii of these balls of capture, in place."""

    @abstractmethod
    def advance(self, which: NDArray[np.int64], samples: Trajectories, early: bool) -> None:
        """Follow these samples to their ends or limits, in place; early: most of them are soon captured."""

    @abstractmethod
    def watch(
        self, which: NDArray[np.int64], least: NDArray[np.float64], periods: NDArray[np.float64], seen: Seen
    ) -> None:
        """Follow these (k,) of the survey's samples with a tangent vector, in place.

        Each is followed for at least `least` impacts and `periods` forcing periods (k,).
        """

    def run(self) -> None:
        """Follow every sample to its end."""
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
        """Return the status (k,) of other states of these cells after at most `most` impacts; all arrays (k,).

        One that reaches no attractor by then is UNRESOLVED, and judged no further. Orbits that they find are known to
        the cells from then on.

        Returns
        -------
        NDArray[np.int64]
            Status of each state.
        """
        others = begun(cell, tau.copy(), v.copy(), most.copy())
        self.settle(np.arange(cell.size), others)
        return np.asarray(others.status)

    def most(self, impacts: Any, cell: NDArray[np.int64]) -> NDArray[np.int64]:
        """So many impacts where damping is strong, as many more as these cells' relaxation takes, within the budget."""
        return np.minimum(impacts * self.longer[cell], self.budget).astype(np.int64)

    @property
    def status(self) -> NDArray[np.int64]:
        """Status of the samples, (n_cells, count)."""
        return np.asarray(self.samples.status.reshape(-1, self.count))

    @property
    def impacts(self) -> NDArray[np.int64]:
        """Impacts of the samples so far, (n_cells, count)."""
        return np.asarray(self.samples.impacts.reshape(-1, self.count))

    def left_in(self, cells: NDArray[np.int64]) -> Sets:
        """Return the samples of these cells that have not ended."""
        left = self.status[cells] == Outcome.UNRESOLVED
        row, column = np.nonzero(left)
        return Sets(cells[row] * self.count + column, left.sum(axis=1))

    def settle(self, which: NDArray[np.int64], samples: Trajectories, early: bool = False) -> None:
        """Follow these samples to their limits; those that recur find an orbit of their cell, or go on."""
        while which.size:
            self.advance(which, samples, early)
            which = which[samples.status[which] == Outcome.RECURRENT]
            self.resolve(which, samples)
            which = which[
                (samples.status[which] == Outcome.UNRESOLVED) & (samples.impacts[which] < samples.limit[which])
            ]

    def resolve(self, which: NDArray[np.int64], samples: Trajectories) -> None:
        """Find the orbits of recurrent samples and their balls, with more room for them where a cell needs it."""
        while which.size:
            which = resolve(which, self.cells, samples, self.orbits, self.balls, self.grown)
            self.grow_balls()
            room = self.orbits.m.shape[1]
            if which.size and (self.orbits.n[samples.cell[which]] == room).any():
                self.make_room(2 * room)

    def grow_balls(self) -> None:
        """Grow balls of capture around points of the orbits that have none yet."""
        if (self.orbits.n == self.grown).all():
            return
        centres = centres_of(self.grown, self.orbits, self.cells)
        self.enlarge(centres)
        enter_balls(centres, self.balls.for_kernels())
        self.grown[:] = self.orbits.n

    def make_room(self, most: int) -> None:
        """Have room for so many orbits in each cell, as often doubled as it takes."""
        while self.orbits.m.shape[1] < most:
            self.orbits, self.balls = with_twice_the_room(self.orbits), with_twice_the_room(self.balls)

    def extend(self, cells: NDArray[np.int64]) -> None:
        """Follow what is left in these cells for longer."""
        self.stage[cells] += 1
        which = self.left_in(cells).which
        cell = self.samples.cell[which]
        self.samples.limit[which] = self.most(impacts_until(self.stage[cell]), cell)
        self.settle(which[self.samples.impacts[which] < self.samples.limit[which]], self.samples)

    def judge(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Measure witnesses in these cells; decided are those where all of them are chaotic and none has ended."""
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
        """Return the cells (k,) in which sets that lose samples slowly are frequent, so that witnesses miss it."""
        return np.asarray(self.weak[cells] | self.has_quiet[cells] | (self.count < MANY))

    def waits_for_leaks(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return the cells (k,) whose unresolved samples are not judged while others still settle."""
        return np.ones(cells.size, np.bool_)

    def outlast(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether nothing leaves what is left in these cells, in as many impacts as the most watched has made.

        Of all samples and, where damping is weak, of so many states near them that there are CROWDS. There, and where
        all may come to rest, sets that lose samples slowly are frequent, and twelve witnesses do not tell them from
        others. Where there are fewer samples than MANY, states near them are watched too: a small count is no reason
        for chaos.

        Returns
        -------
        NDArray[np.bool_]
            True for cells in which nothing leaves.
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
        """Return whether neighbours of the unresolved samples of these cells stay unresolved too.

        Each is followed for as many impacts as any sample: in chaos they soon have nothing in common.

        Returns
        -------
        NDArray[np.bool_]
            Flags (k,) of the cells whose neighbours stay unresolved.
        """
        if not cells.size:
            return np.zeros(0, np.bool_)
        left, each = self.left_in(cells), np.arange(first, last)
        others = self.states_beside(left, each, left.largest(self.samples.impacts))
        fresh = (each >= left.size[:, None]).ravel()  # the others are the samples themselves
        gone, others = np.zeros(fresh.size, np.bool_), others.take(fresh)
        self.settle(np.arange(others.cell.size), others)
        strong = ~self.weak[others.cell]  # elsewhere the larger crowd makes up for it
        chattering = self.may_rest(others.cell, others.time, PERIODS * self.longer[others.cell])
        gone[fresh] = (others.status != Outcome.UNRESOLVED) | (strong & chattering)
        return ~np.asarray(gone.reshape(-1, each.size).any(axis=1))

    def states_beside(self, left: Sets, number: NDArray[np.int64], most: NDArray[np.int64]) -> Trajectories:
        """Return states at what is left of each cell in turn, and from the second turn on beside it.

        Parameters
        ----------
        left : Sets
            The unresolved samples of n cells.
        number : ndarray of int, (k,) or (n, k)
            The number of each state, counted through those turns.
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
        """Return whether samples may be chattering: followed for `time`, where `periods` were expected."""
        return np.asarray(self.has_quiet[cell] & (time < CHATTERING * periods))

    def measure(self, which: NDArray[np.int64], times: float = 1.0) -> tuple[Seen, NDArray[np.bool_]]:
        """Observe these samples, for longer if unclear.

        Return the observations, and whether each is unresolved and chaotic.

        Returns
        -------
        tuple[Seen, NDArray[np.bool_]]
            The observations, and the flags of chaos.
        """
        seen, chaotic = nothing_seen(which.size), np.zeros(which.size, np.bool_)
        samples = self.samples
        pace = samples.time / np.maximum(samples.impacts, 1)
        todo = np.flatnonzero(samples.impacts[which] < self.budget)
        for extension in range(EXTENSIONS + 1):
            if not todo.size:
                break
            todo = todo[np.argsort(pace[which[todo]], kind="stable")]  # the longest first, so that all end together
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
            stopped = chattering | (time < PERIODS * longer) & (room < most)  # by the budget
            chaotic[todo] = left & ~stopped & are_chaotic(part.sums)
            todo = todo[left & ~chaotic[todo] & ~stopped & (samples.impacts[now] < self.budget)]
        return seen, chaotic

    def declare_chaos(self, cells: NDArray[np.int64], witnesses: Sets, seen: Seen) -> NDArray[np.bool_]:
        """Declare the unresolved samples of each of these cells to be on the chaotic attractor of its probes.

        If the probes seem to be on several, they are measured for longer, and at last all unresolved samples.

        Returns
        -------
        NDArray[np.bool_]
            False where this is not so.
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
        """Declare the unresolved samples of each of these cells to be on several chaotic attractors.

        Unless some of them end elsewhere.

        Returns
        -------
        NDArray[np.bool_]
            True for cells of which this is so.
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
        """Return whether the footprints (k, GRID) of a cell's samples are in several groups, of every cell."""
        number = np.zeros(sets.which.size, np.int64)
        group_numbers(prints.copy(), sets.size, number)
        return ~sets.all_of(number == 0)

    def traced(self, which: NDArray[np.int64], prints: NDArray[np.uint64]) -> NDArray[np.uint64]:
        """Return these visited-cell bitmaps with those of a further stretch of the samples (k,)."""
        mark_footprints(which, TRACED, self.cells, self.samples, prints)
        return prints

    def watched(self, which: NDArray[np.int64]) -> float:
        """Return the forcing periods for which all of these samples were followed."""
        return float(self.samples.time[which].min())


def impacts_until(stage: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the most impacts of a sample to the end of these stages, where damping is strong."""
    return np.where(stage == 0, float(FIRST), SECOND * float(GROWTH) ** (stage - 1))


def begun(
    cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], limit: NDArray[np.int64] | int
) -> Trajectories:
    """Return samples (k,) that have made no impact, with a limit of impacts; the arrays are followed in place."""
    return Trajectories(
        cell=np.ascontiguousarray(cell),  # another layout would be another variant of each kernel
        tau=tau,
        v=v,
        limit=np.broadcast_to(limit, cell.shape).astype(np.int64),
        time=np.zeros(cell.size),
        **{name: np.zeros(cell.size, np.int64) for name in ("impacts", "status", "orbit", "gap", "pause")},
    )


def nothing_seen(count: int) -> Seen:
    """Room for what is seen of so many samples."""
    return Seen(np.zeros((count, BATCHES, 3)), np.zeros((count, GRID), np.uint64))
