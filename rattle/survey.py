"""Which attractors the samples of many cells go to, with as few impacts as certainty allows.

Every sample is followed until it is captured or has made FIRST impacts. In a cell where some are left, a few of them,
the witnesses, are measured for longer with a tangent vector: they show what the others do, or that all must be followed
for longer. docs/decisions/0007-survey-cost.md has the reasons and the figures.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.discover import BALLS_PER_ORBIT, remember_period_one, resolve, trace
from rattle.family import period_one_cells
from rattle.footprints import groups_of
from rattle.iterate import working_block
from rattle.limits import sine_offset
from rattle.lyapunov import BATCHES, is_chaotic
from rattle.quiet import capture_invariants
from rattle.settle import CHUNK, GRID, LEFT, LONG_CHUNK, RECURRENT, Balls, Cells, Orbits, Samples, measure, settle

PILOT = 8  # samples per cell that look for its orbits first, so that the others need not find them again
FIRST = 128  # impacts that every sample may make before the cell is judged
GROWTH = 4  # every further stage lasts this many times as long
STAGES = 4
FEW = 8  # where no more than one in so many is left, there is one stage more
MEASURED, PERIODS = 2000, 1000.0  # least impacts and forcing periods of one witness
MOST_MEASURED = 20_000  # impacts of a witness that never gets through its periods
WITNESSES = 12  # per cell: if one in 3000 periods leaves a chaotic set, 98 % of the cells show it
TRACED = 1000  # impacts of a footprint without gaps
LONGER = 4  # witnesses that seem to be on different attractors are watched this many times as long
LEAKS_MISSED = 3.0  # a set that loses samples is left by none for so long with probability e^(−3)
EXTENSIONS = 3  # an unclear exponent is measured again over twice the impacts, this many times
ROOM = 8  # orbits per cell to begin with; doubled where a cell has more


class Chaos(NamedTuple):
    """A chaotic attractor of one cell: the samples that are on it, and the batch sums of those measured."""

    samples: NDArray[np.int64]
    sums: NDArray[np.float64]


class Survey:
    """The samples of a block of cells on their way, and what is known of the cells."""

    def __init__(self, cells: Any, tau: NDArray[np.float64], v: NDArray[np.float64]) -> None:
        """Take cells as the kernels do, and initial conditions of shape (n_cells, count)."""
        n_cells, self.count = tau.shape
        self.cells = cells
        counters = (np.zeros(tau.size, np.int64) for _ in range(6))
        self.samples = Samples(np.repeat(np.arange(n_cells), self.count), tau.ravel(), v.ravel(), *counters)
        self.samples.limit[:] = FIRST
        self.orbits, self.balls = _empty_tables(n_cells)
        self.chaos: dict[int, list[Chaos]] = {}
        self.stage = np.zeros(n_cells, np.int64)
        self.unclear = np.zeros(n_cells, np.bool_)  # witnesses told nothing: measuring again would not either
        self.paths = np.zeros(2, np.int64)
        self.block = working_block()
        self.enter_period_one()

    def enter_period_one(self) -> None:
        """The stable ones of A–D are known beforehand."""
        delta, epsilon, beta, _capture = self.cells
        order = np.lexsort((delta, beta))
        found = period_one_cells(order, delta, epsilon, beta, sine_offset(delta))
        remember_period_one(*found, self.cells, self.orbits, self.balls)

    def run(self) -> None:
        """Follow every sample to its end."""
        index = np.arange(self.samples.cell.size).reshape(-1, self.count)
        pilot = np.zeros(self.count, np.bool_)
        pilot[np.arange(min(PILOT, self.count)) * self.count // min(PILOT, self.count)] = True
        self.settle(index[:, pilot].ravel())
        self.settle(index[:, ~pilot].ravel())
        pending = np.arange(len(index))
        while pending.size:
            pending = pending[(self.status[pending] == LEFT).any(axis=1)]
            leaking = self.leaking(pending)
            decided = np.zeros(pending.size, np.bool_)
            judged = ~leaking
            decided[judged] = self.judge(pending[judged])
            few = (self.status[pending] == LEFT).sum(axis=1) <= self.count // FEW
            decided |= self.stage[pending] >= STAGES + few
            pending = pending[~decided]
            self.extend(pending)

    def settled(
        self, cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], most: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Status (k,) of other states of these cells after so many impacts at most, all (k,): one that reaches no
        attractor by then is LEFT, and judged no further. What orbits they find, the survey knows from then on.
        """
        sample = self.samples
        impacts, *others = (np.zeros(cell.size, np.int64) for _ in range(5))
        self.samples = Samples(cell, tau.copy(), v.copy(), impacts, most.copy(), *others)
        self.settle(np.arange(cell.size))
        status, self.samples = self.samples.status, sample
        return status

    @property
    def status(self) -> NDArray[np.int64]:
        """Status of the samples, (n_cells, count)."""
        return self.samples.status.reshape(-1, self.count)

    def left_in(self, cell: int) -> NDArray[np.int64]:
        """The samples of a cell that have not ended."""
        return cell * self.count + np.flatnonzero(self.status[cell] == LEFT)

    def settle(self, which: NDArray[np.int64]) -> None:
        """Follow samples to their limits; those that recur find an orbit of their cell, or go on."""
        while which.size:
            self.advance(which)
            which = which[self.samples.status[which] == RECURRENT]
            self.resolve(which)
            on = (self.samples.status[which] == LEFT) & (self.samples.impacts[which] < self.samples.limit[which])
            which = which[on]

    def advance(self, which: NDArray[np.int64]) -> None:
        """Follow samples to their ends or limits."""
        flights = CHUNK if self.samples.limit[which[0]] <= FIRST else LONG_CHUNK
        settle(self.block, which, flights, self.cells, self.samples, self.balls, self.paths)

    def watch(
        self,
        which: NDArray[np.int64],
        least: int,
        periods: float,
        sums: NDArray[np.float64],
        prints: NDArray[np.uint64],
    ) -> None:
        """Follow samples with a tangent vector, for so many impacts and forcing periods at least."""
        measure(self.block, which, least, periods, self.cells, self.samples, self.balls, sums, prints, self.paths)

    def resolve(self, which: NDArray[np.int64]) -> None:
        """Find the orbits of recurrent samples, with more room for them where a cell needs it."""
        while which.size:
            which = which[resolve(which, self.cells, self.samples, self.orbits, self.balls) :]
            if which.size:
                self.orbits = Orbits(self.orbits.n, *_doubled(self.orbits[1:]))
                self.balls = Balls(self.balls.n, *_doubled(self.balls[1:]))

    def leaking(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether what is left in these cells may still settle: others settled, to begin with, or did so later and
        what is left has not outlasted them by enough since.

        Were it the same leaking set, LEAKS_MISSED more would have left it by now, at the rate until the last one did.
        """
        settled, impacts = self.status[cells] != LEFT, self.samples.impacts.reshape(-1, self.count)[cells]
        leaked = settled & (impacts > FIRST)
        last = np.where(leaked, impacts, 0).max(axis=1, initial=0)[:, None]
        since = np.where(settled, 0, np.maximum(impacts - last, 0)).sum(axis=1)
        before = np.minimum(impacts, last).sum(axis=1)
        doubtful = leaked.any(axis=1) & (leaked.sum(axis=1) * since < LEAKS_MISSED * before)
        return doubtful | (self.stage[cells] == 0) & settled.any(axis=1) | self.unclear[cells]

    def limits(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        """Impacts that the samples of these cells may make at their stage."""
        return FIRST * GROWTH ** self.stage[cells]

    def extend(self, cells: NDArray[np.int64]) -> None:
        """Follow what is left in these cells for longer."""
        self.stage[cells] += 1
        which = np.concatenate([np.zeros(0, np.int64), *(self.left_in(cell) for cell in cells)])
        self.samples.limit[which] = self.limits(self.samples.cell[which])
        self.settle(which[self.samples.impacts[which] < self.samples.limit[which]])

    def judge(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Measure witnesses in these cells; decided are those where all of them are chaotic and none has ended."""
        if not cells.size:
            return np.zeros(0, np.bool_)
        chosen = [self.witnesses(int(cell)) for cell in cells]
        sums, prints, chaotic = self.measure(np.concatenate(chosen))
        ends = np.cumsum([each.size for each in chosen])
        decided = np.zeros(cells.size, np.bool_)
        for i, cell in enumerate(cells):
            span = slice(ends[i] - chosen[i].size, ends[i])
            if chaotic[span].all():
                decided[i] = self.declare_chaos(int(cell), chosen[i], sums[span], prints[span])
            else:
                self.unclear[cell] = (self.samples.status[chosen[i]] == LEFT).all()
        return decided

    def witnesses(self, cell: int) -> NDArray[np.int64]:
        """Some of the samples left in a cell, evenly among them."""
        left = self.left_in(cell)
        n = min(WITNESSES, left.size)
        return left[np.arange(n) * left.size // n]

    def measure(
        self, which: NDArray[np.int64], times: int = 1
    ) -> tuple[NDArray[np.float64], NDArray[np.uint64], NDArray[np.bool_]]:
        """Batch sums, footprints, and whether a sample is left and chaotic; if unclear, measured for longer."""
        sums, prints = np.zeros((which.size, BATCHES, 3)), np.zeros((which.size, GRID), np.uint64)
        chaotic = np.zeros(which.size, np.bool_)
        todo, samples = np.arange(which.size), self.samples
        for extension in range(EXTENSIONS + 1):
            now = which[todo]
            longer = times * 2**extension
            samples.limit[now] = samples.impacts[now] + MOST_MEASURED * longer
            part, marks = np.zeros((todo.size, BATCHES, 3)), np.zeros((todo.size, GRID), np.uint64)
            self.watch(now, MEASURED * longer, PERIODS * longer, part, marks)
            self.resolve(now[samples.status[now] == RECURRENT])
            sums[todo], prints[todo] = part, marks
            left = samples.status[now] == LEFT
            quick = part[:, :, 0].sum(axis=1) < 0.5 * PERIODS * longer  # spent its impacts first, on small bounces
            chattering = quick & (self.cells.capture[samples.cell[now]] > 0)  # which may be about to become quiet
            chaotic[todo] = left & ~chattering & np.array([is_chaotic(each) for each in part])
            todo = todo[left & ~chaotic[todo] & ~chattering]
            if not todo.size:
                break
        return sums, prints, chaotic

    def declare_chaos(
        self, cell: int, which: NDArray[np.int64], sums: NDArray[np.float64], prints: NDArray[np.uint64]
    ) -> bool:
        """All that is left in the cell is on the chaotic attractor of the witnesses. If these seem to be on several,
        they are measured for longer, and at last all that is left. False if some of those then end elsewhere.
        """
        if len(groups_of(prints)) > 1:
            trace(which, TRACED, self.cells, self.samples, prints)
        if len(groups_of(prints)) > 1:
            sums, more, chaotic = self.measure(which, LONGER)
            prints |= more
            if not chaotic.all():
                return False
        if len(groups_of(prints)) == 1:
            self.chaos[cell] = [Chaos(self.left_in(cell), sums)]
            return True
        which = self.left_in(cell)
        sums, prints, chaotic = self.measure(which, LONGER)
        if chaotic.all():
            trace(which, TRACED, self.cells, self.samples, prints)
            self.chaos[cell] = [Chaos(which[group], sums[group]) for group in groups_of(prints)]
        return bool(chaotic.all())


def _doubled(columns: tuple[NDArray[Any], ...]) -> list[NDArray[Any]]:
    return [np.concatenate([x, np.zeros_like(x)], axis=1) for x in columns]


def _empty_tables(n_cells: int) -> tuple[Orbits, Balls]:
    room, balls = (n_cells, ROOM), (n_cells, ROOM * BALLS_PER_ORBIT)
    labels = (np.zeros(room, np.int64) for _ in range(3))
    orbits = Orbits(np.zeros(n_cells, np.int64), *labels, *(np.zeros(room) for _ in range(4)))
    return orbits, Balls(np.zeros(n_cells, np.int64), np.zeros(balls, np.int64), *(np.zeros(balls) for _ in range(5)))


def followed(
    delta: NDArray[np.float64],
    epsilon: NDArray[np.float64],
    beta: NDArray[np.float64],
    tau: NDArray[np.float64],
    v: NDArray[np.float64],
) -> Survey:
    """The samples (τ, v) of shape (n, count) of cells with parameters (n,), each followed to its end."""
    survey = Survey(Cells(delta, epsilon, beta, capture_invariants(delta, epsilon, beta)), tau, v)
    survey.run()
    return survey
