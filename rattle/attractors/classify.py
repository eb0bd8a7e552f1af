"""Which attractors the samples of many cells go to, with as few impacts as certainty allows.

Every sample is followed until it is captured or has made FIRST impacts. In a cell where some are left, a few of them,
the witnesses, are measured for longer with a tangent vector: they show what the others do, or that all must be followed
for longer. docs/decisions/0007-survey-cost.md has the reasons and the figures.
"""

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.chaos import BATCHES, groups_of, is_chaotic
from rattle.attractors.recurrence import BALLS_PER_ORBIT, mark_footprints, resolve
from rattle.attractors.samples import GRID, LEFT, RECURRENT, Balls, Orbits, Samples

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


class Seen(NamedTuple):
    """Of k samples that were watched: batch sums (k, BATCHES, 3), footprints (k, GRID)."""

    sums: NDArray[np.float64]
    prints: NDArray[np.uint64]


class Classifier(ABC):
    """The samples of a block of cells on their way, and what is known of the cells; a gear says how they go on."""

    def __init__(self, cells: Any, tau: NDArray[np.float64], v: NDArray[np.float64]) -> None:
        """Take cells as the kernels do, and initial conditions of shape (n_cells, count)."""
        n_cells, self.count = tau.shape
        self.cells = cells
        self.samples = begun(np.repeat(np.arange(n_cells), self.count), tau.ravel(), v.ravel(), FIRST)
        self.orbits, self.balls = _empty_tables(n_cells)
        self.chaos: dict[int, list[Chaos]] = {}
        self.stage = np.zeros(n_cells, np.int64)
        self.unclear = np.zeros(n_cells, np.bool_)  # witnesses told nothing: measuring again would not either
        self.enter_known_orbits()

    @property
    @abstractmethod
    def has_quiet(self) -> NDArray[np.bool_]:
        """Whether the cells (n_cells,) have a quiet motion."""

    @abstractmethod
    def enter_known_orbits(self) -> None:
        """Enter into the tables what is known of the cells beforehand."""

    @abstractmethod
    def advance(self, which: NDArray[np.int64], samples: Samples) -> None:
        """Follow these samples to their ends or limits, in place."""

    @abstractmethod
    def watch(self, which: NDArray[np.int64], least: int, periods: float, seen: Seen) -> None:
        """Follow these of the survey's samples with a tangent vector, for so many impacts and forcing periods at least,
        in place.
        """

    def run(self) -> None:
        """Follow every sample to its end."""
        index = np.arange(self.samples.cell.size).reshape(-1, self.count)
        pilot = np.zeros(self.count, np.bool_)
        pilot[np.arange(min(PILOT, self.count)) * self.count // min(PILOT, self.count)] = True
        self.settle(index[:, pilot].ravel(), self.samples)
        self.settle(index[:, ~pilot].ravel(), self.samples)
        pending = np.arange(len(index))
        while pending.size:
            pending = pending[(self.status[pending] == LEFT).any(axis=1)]
            doubtful = (self.stage[pending] == 0) & (self.status[pending] != LEFT).any(axis=1) | self.unclear[pending]
            leaks = doubtful | leaking(self.status[pending], self.impacts[pending])
            decided = np.zeros(pending.size, np.bool_)
            decided[~leaks] = self.judge(pending[~leaks])
            few = (self.status[pending] == LEFT).sum(axis=1) <= self.count // FEW
            decided |= self.stage[pending] >= STAGES + few
            pending = pending[~decided]
            self.extend(pending)

    def settled(
        self, cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], most: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Status (k,) of other states of these cells after so many impacts at most, all (k,): one that reaches no
        attractor by then is LEFT, and judged no further. What orbits they find is known from then on.
        """
        others = begun(cell, tau.copy(), v.copy(), most.copy())
        self.settle(np.arange(cell.size), others)
        return np.asarray(others.status)

    @property
    def status(self) -> NDArray[np.int64]:
        """Status of the samples, (n_cells, count)."""
        return np.asarray(self.samples.status.reshape(-1, self.count))

    @property
    def impacts(self) -> NDArray[np.int64]:
        """Impacts of the samples so far, (n_cells, count)."""
        return np.asarray(self.samples.impacts.reshape(-1, self.count))

    def left_in(self, cell: int) -> NDArray[np.int64]:
        """The samples of a cell that have not ended."""
        return cell * self.count + np.flatnonzero(self.status[cell] == LEFT)

    def settle(self, which: NDArray[np.int64], samples: Samples) -> None:
        """Follow these samples to their limits; those that recur find an orbit of their cell, or go on."""
        while which.size:
            self.advance(which, samples)
            which = which[samples.status[which] == RECURRENT]
            self.resolve(which, samples)
            which = which[(samples.status[which] == LEFT) & (samples.impacts[which] < samples.limit[which])]

    def resolve(self, which: NDArray[np.int64], samples: Samples) -> None:
        """Find the orbits of recurrent samples, with more room for them where a cell needs it."""
        while which.size:
            which = which[resolve(which, self.cells, samples, self.orbits, self.balls) :]
            if which.size:
                self.orbits = Orbits(self.orbits.n, *_doubled(self.orbits[1:]))
                self.balls = Balls(self.balls.n, *_doubled(self.balls[1:]))

    def extend(self, cells: NDArray[np.int64]) -> None:
        """Follow what is left in these cells for longer."""
        self.stage[cells] += 1
        which = np.concatenate([np.zeros(0, np.int64), *(self.left_in(cell) for cell in cells)])
        self.samples.limit[which] = FIRST * GROWTH ** self.stage[self.samples.cell[which]]
        self.settle(which[self.samples.impacts[which] < self.samples.limit[which]], self.samples)

    def judge(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Measure witnesses in these cells; decided are those where all of them are chaotic and none has ended."""
        if not cells.size:
            return np.zeros(0, np.bool_)
        chosen = [evenly(self.left_in(int(cell)), WITNESSES) for cell in cells]
        seen, chaotic = self.measure(np.concatenate(chosen))
        ends = np.cumsum([each.size for each in chosen])
        decided = np.zeros(cells.size, np.bool_)
        for i, cell in enumerate(cells):
            span = slice(ends[i] - chosen[i].size, ends[i])
            if chaotic[span].all():
                decided[i] = self.declare_chaos(int(cell), chosen[i], Seen(seen.sums[span], seen.prints[span]))
            else:
                self.unclear[cell] = (self.samples.status[chosen[i]] == LEFT).all()
        return decided

    def measure(self, which: NDArray[np.int64], times: int = 1) -> tuple[Seen, NDArray[np.bool_]]:
        """What is seen of these samples, and whether each is left and chaotic; if unclear, measured for longer."""
        seen, chaotic = nothing_seen(which.size), np.zeros(which.size, np.bool_)
        todo, samples = np.arange(which.size), self.samples
        for extension in range(EXTENSIONS + 1):
            now = which[todo]
            longer = times * 2**extension
            samples.limit[now] = samples.impacts[now] + MOST_MEASURED * longer
            part = nothing_seen(todo.size)
            self.watch(now, MEASURED * longer, PERIODS * longer, part)
            self.resolve(now[samples.status[now] == RECURRENT], samples)
            seen.sums[todo], seen.prints[todo] = part
            left = samples.status[now] == LEFT
            quick = part.sums[:, :, 0].sum(axis=1) < 0.5 * PERIODS * longer  # spent its impacts first, on small bounces
            chattering = quick & self.has_quiet[samples.cell[now]]  # which may be about to become quiet
            chaotic[todo] = left & ~chattering & np.array([is_chaotic(each) for each in part.sums])
            todo = todo[left & ~chaotic[todo] & ~chattering]
            if not todo.size:
                break
        return seen, chaotic

    def declare_chaos(self, cell: int, which: NDArray[np.int64], seen: Seen) -> bool:
        """All that is left in the cell is on the chaotic attractor of the witnesses. If these seem to be on several,
        they are measured for longer, and at last all that is left. False if some of those then end elsewhere.
        """
        sums, prints = seen
        if len(groups_of(prints)) > 1:
            mark_footprints(which, TRACED, self.cells, self.samples, prints)
        if len(groups_of(prints)) > 1:
            (sums, more), chaotic = self.measure(which, LONGER)
            prints |= more
            if not chaotic.all():
                return False
        if len(groups_of(prints)) == 1:
            self.chaos[cell] = [Chaos(self.left_in(cell), sums)]
            return True
        which = self.left_in(cell)
        (sums, prints), chaotic = self.measure(which, LONGER)
        if chaotic.all():
            mark_footprints(which, TRACED, self.cells, self.samples, prints)
            self.chaos[cell] = [Chaos(which[group], sums[group]) for group in groups_of(prints)]
        return bool(chaotic.all())


def begun(
    cell: NDArray[np.int64], tau: NDArray[np.float64], v: NDArray[np.float64], limit: NDArray[np.int64] | int
) -> Samples:
    """Samples (k,) that have made no impact yet, and so many at most; the arrays are followed in place."""
    impacts, limits, *others = (np.zeros(cell.size, np.int64) for _ in range(6))
    limits[:] = limit
    return Samples(cell, tau, v, impacts, limits, *others)


def leaking(status: NDArray[np.int64], impacts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether what is left in cells (n,) may still settle, from status and impacts (n, count): others settled later
    than to begin with, and what is left has not outlasted them by enough since.

    Were it the same leaking set, LEAKS_MISSED more would have left it by now, at the rate until the last one did.
    """
    settled = status != LEFT
    leaked = settled & (impacts > FIRST)
    last = np.where(leaked, impacts, 0).max(axis=1, initial=0)[:, None]
    since = np.where(settled, 0, np.maximum(impacts - last, 0)).sum(axis=1)
    before = np.minimum(impacts, last).sum(axis=1)
    return np.asarray(leaked.any(axis=1) & (leaked.sum(axis=1) * since < LEAKS_MISSED * before))


def evenly(which: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """At most so many of these, evenly among them."""
    n = min(most, which.size)
    return which[np.arange(n) * which.size // n]


def nothing_seen(count: int) -> Seen:
    """Room for what is seen of so many samples."""
    return Seen(np.zeros((count, BATCHES, 3)), np.zeros((count, GRID), np.uint64))


def _doubled(columns: tuple[NDArray[Any], ...]) -> list[NDArray[Any]]:
    return [np.concatenate([x, np.zeros_like(x)], axis=1) for x in columns]


def _empty_tables(n_cells: int) -> tuple[Orbits, Balls]:
    room, balls = (n_cells, ROOM), (n_cells, ROOM * BALLS_PER_ORBIT)
    labels = (np.zeros(room, np.int64) for _ in range(3))
    orbits = Orbits(np.zeros(n_cells, np.int64), *labels, *(np.zeros(room) for _ in range(4)))
    return orbits, Balls(np.zeros(n_cells, np.int64), np.zeros(balls, np.int64), *(np.zeros(balls) for _ in range(5)))
