"""Follow attractors step by step along a line of parameters, forward and backward, as in an experiment.

    known = the attractors that a sample of states finds at every step
    start a run forward from each known attractor at the first step, and backward from each at the last step; finish
    for each step, while it has a known attractor that no run has reached in either direction:
        start a run forward from this attractor; finish. If no sample found the attractor, the run also ends at
            attractors that only backward runs have reached.

    finish: until all runs have ended, follow the state of each run at its next step to an attractor:
        quiet motion, or an attractor that a run in this direction has reached before: the run ends. A run in the
            opposite direction starts from the attractor that the ended run had reached at the step before.
        quiet motion, and the end of an earlier run had started this run: besides, a new run in the direction of this
            run starts, from the attractor that the earlier run had reached at this step. (If this run ends at its first
            step, the new one starts from the attractor of the next step.)
        any other attractor: it becomes known and reached in this direction. The run goes on from it to the next step,
            and ends after the last one.

In this way all known attractors are followed. Where the two directions reach different attractors, there is hysteresis.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.samples import Outcome
from rattle.attractors.table import AttractorTable, tabulate_attractors
from rattle.continuation.motions import MotionsOnSegment
from rattle.parameters import Parameters

FORWARD, BACKWARD = 0, 1
#: A forward run goes from each step to the next, and a backward run to the one before.
STEP_OF_DIRECTION = (1, -1)
Array = NDArray[np.float64]


@dataclass
class KnownAttractor:
    """An attractor that is known at one step: from samples, from a run, or from a branch.

    kind: the number of its kind in KINDS. label: (m, n_plus, n_minus). tau, v: a state on the attractor.
    sampled: whether the initial conditions sampled at this step found it.
    is_reached: whether a forward run reached it, and whether a backward run did.
    """

    kind: int
    label: tuple[int, int, int]
    tau: float
    v: float
    sampled: bool
    is_reached: list[bool] = field(default_factory=lambda: [False, False])


class ReachedAttractor(NamedTuple):
    """The attractor that a run reached at one step.

    step: the number of the step. direction: FORWARD or BACKWARD. kind: the number of the attractor's kind in KINDS.
    label: (m, n_plus, n_minus). tau, v: a state on the attractor.
    """

    step: int
    direction: int
    kind: int
    label: tuple[int, int, int]
    tau: float
    v: float


class SweepPoints(NamedTuple):
    """Impacts on Σ⁺ of the attractors that were followed, as arrays (n,) in the order of the steps.

    step, position: the number of the step, and its position along the line.
    tau, v: phase and speed of the impact.
    kind: the number of the attractor's kind in KINDS. m, n_plus, n_minus: its label, 0 unless it is periodic.
    forward: whether the attractor was followed forward.
    A periodic attractor has n_plus points at each step and direction.
    """

    step: NDArray[np.int64]
    position: Array
    tau: Array
    v: Array
    kind: NDArray[np.int64]
    m: NDArray[np.int64]
    n_plus: NDArray[np.int64]
    n_minus: NDArray[np.int64]
    forward: NDArray[np.bool_]


@dataclass
class _SweepRun:
    """A run: a motion that is followed from step to step in one direction.

    step: the number of the next step.
    tau, v: the state of the run at the step before; before its first step, a state of the attractor where it starts.
    trail: the attractors that the run reached, by step.
    earlier_trail: the trail of the earlier run, in the other direction, whose end started this run; empty if none did.
    stops_at_known: True: the run ends at an attractor that a run in either direction has reached before. False: only an
    attractor that a run in the same direction has reached before ends it.
    """

    direction: int
    step: int
    tau: float
    v: float
    earlier_trail: dict[int, KnownAttractor]
    stops_at_known: bool
    trail: dict[int, KnownAttractor] = field(default_factory=dict)


class Sweeps:
    """Forward and backward sweeps along the steps of a line of parameters, for one model.

    At first the periodic and chaotic attractors of `table` are known; cell i of the table is step i.
    """

    def __init__(self, model: MotionsOnSegment, steps: Parameters, table: AttractorTable) -> None:
        self.model, self.steps = model, steps
        self.known: list[list[KnownAttractor]] = [[] for _ in range(steps.size)]
        self.visits: list[ReachedAttractor] = []
        self._runs: list[_SweepRun] = []
        for i in np.flatnonzero((table.kind != Outcome.QUIET) & (table.kind != Outcome.UNDECIDED)):
            state, sampled = (float(table.tau[i]), float(table.v[i])), bool(table.samples[i])
            known = KnownAttractor(int(table.kind[i]), table.label(i), *state, sampled=sampled)
            self.known[table.cell[i]].append(known)

    def run(self) -> None:
        """Start runs from known attractors, until each known attractor was reached by a run or is removed.

        A known attractor is removed from `known` if the run from its own state does not reach it. Such a run ends at
        its first step, in quiet motion or at an attractor that a run had reached before.
        """
        for direction, step in ((FORWARD, 0), (BACKWARD, len(self.known) - 1)):
            for known in self.known[step]:
                self._start_run(known, direction, step)
        self._finish_runs()
        for step in range(len(self.known)):
            while True:
                left = [known for known in self.known[step] if not any(known.is_reached)]
                if not left:
                    break
                for known in left:
                    self._start_run(known, FORWARD, step, stops_at_known=not known.sampled)
                self._finish_runs()
                self.known[step] = [known for known in self.known[step] if any(known.is_reached) or known not in left]

    def _start_run(
        self,
        known: KnownAttractor | None,
        direction: int,
        step: int,
        back: dict[int, KnownAttractor] | None = None,
        stops_at_known: bool = False,
    ) -> None:
        """Start a run from a known attractor at a step, unless a run in this direction has already reached it.

        If `known` is None, no run starts. back, stops_at_known: fields `earlier_trail` and `stops_at_known` of the new
        `_SweepRun`. `back` is the trail of the earlier run whose end starts the new run, or None if the new run does
        not start at the end of another.
        """
        if known is not None and not known.is_reached[direction]:
            self._runs.append(_SweepRun(direction, step, known.tau, known.v, back or {}, stops_at_known))

    def _finish_runs(self) -> None:
        """Advance all runs to their ends, also the new runs that start when a run ends.

        Runs with the same next step take this step one after another, in the order in which they started.
        """
        while self._runs:
            now: dict[int, _SweepRun] = {}
            for run in self._runs:
                now.setdefault(run.step, run)
            self._advance_runs(list(now.values()))

    def _advance_runs(self, runs: list[_SweepRun]) -> None:
        """Advance each run by one step. No two of the runs may have the same next step.

        The state of a run is followed, at the parameters of its next step, until it reaches an attractor. The states of
        the known attractors of this step are followed too. This shows whether the run reached one of them.
        """
        states = [[(run.tau, run.v), *((known.tau, known.v) for known in self.known[run.step])] for run in runs]
        count = max(map(len, states))
        tau, v = (np.array([[s[i] for s in (here * count)[:count]] for here in states]) for i in (0, 1))
        at = [run.step for run in runs]
        classifier = self.model.classify(self.steps.take(at), tau, v)
        table, rows = tabulate_attractors(classifier)
        for i, run in enumerate(runs):
            first = i * count
            end = float(classifier.samples.tau[first]), float(classifier.samples.v[first])
            self._record_arrival(run, table, rows[first : first + len(states[i])], end)

    def _record_arrival(
        self, run: _SweepRun, table: AttractorTable, rows: NDArray[np.int64], end: tuple[float, float]
    ) -> None:
        """Record the attractor that a run reached and move the run to its next step; or end the run.

        The run ends after the last step, in quiet motion, or at an attractor that had been reached before
        (`_SweepRun`). If it ends in quiet motion or at such an attractor, a run in the opposite direction starts from
        the attractor that the ended run had reached at the step before.

        If the run ends in quiet motion and the end of an earlier run had started it (`earlier_trail`), a second run
        starts. It has the direction of the ended run, and starts from the attractor that the earlier run had reached at
        this step. If this is the first step of the ended run, the second run starts at the next step instead. This
        happens on chaotic sets that samples leave after some time.

        rows: the row of `table` with the attractor that the run went to, then the rows with the attractors that the
        states of the step's known attractors went to. end: the state of the run after it was followed.
        """
        row, here = rows[0], self.known[run.step]
        kind = int(table.kind[row])
        same = [known for known, other in zip(here, rows[1:], strict=True) if other == row]
        before = [any(known.is_reached) if run.stops_at_known else known.is_reached[run.direction] for known in same]
        if kind == Outcome.QUIET or any(before):
            self._runs.remove(run)
            last = run.step - STEP_OF_DIRECTION[run.direction]
            self._start_run(run.trail.get(last), 1 - run.direction, last, run.trail)
            again = run.step if run.trail else run.step + STEP_OF_DIRECTION[run.direction]
            if kind == Outcome.QUIET:
                self._start_run(run.earlier_trail.get(again), run.direction, again, run.earlier_trail)
            return
        label = int(table.m[row]), int(table.n_plus[row]), int(table.n_minus[row])
        if kind == Outcome.PERIODIC:
            end = float(table.tau[row]), float(table.v[row])
        if not same:
            same = [KnownAttractor(kind, label, *end, sampled=False)]
            here += same
        for known in same:
            known.is_reached[run.direction] = True
        self.visits.append(ReachedAttractor(run.step, run.direction, kind, label, *end))
        run.trail[run.step] = same[0]
        run.step += STEP_OF_DIRECTION[run.direction]
        run.tau, run.v = end
        if not 0 <= run.step < len(self.known):
            self._runs.remove(run)

    def impacts_on_attractors(self, position: Array, chaotic: int) -> SweepPoints:
        """Return impacts on Σ⁺ of all attractors that runs reached.

        position (steps,): the positions of the steps. chaotic: the number of impacts by which a chaotic attractor is
        represented. A periodic attractor is represented by all impacts of a period.

        Returns
        -------
        SweepPoints
            The impacts, in the order of the steps.
        """
        visits = sorted(self.visits, key=lambda visit: (visit.step, visit.direction, visit.v))
        step, direction, kind = (np.array([visit[i] for visit in visits], np.int64) for i in range(3))
        label = np.array([visit.label for visit in visits], np.int64).reshape(-1, 3)
        label[kind != Outcome.PERIODIC] = 0
        size = np.where(kind == Outcome.PERIODIC, label[:, 1], chaotic)
        owner, tau, v = self._states_on_reached_attractors(visits, size, self.steps.take(step))
        m, n_plus, n_minus = label[owner].T
        at = step[owner]
        return SweepPoints(at, position[at], tau, v, kind[owner], m, n_plus, n_minus, direction[owner] == FORWARD)

    def _states_on_reached_attractors(
        self, visits: Iterable[ReachedAttractor], size: NDArray[np.int64], steps: Parameters
    ) -> tuple[NDArray[np.int64], Array, Array]:
        """Return `size[i]` successive states on the attractor visits[i], for all i in order.

        Returns
        -------
        tuple[NDArray[np.int64], Array, Array]
            For each state the number i of its attractor, τ and v.
        """
        states = np.array([(visit.tau, visit.v) for visit in visits]).reshape(-1, 2)
        owner, order, tau, v = [], [], [], []
        which, (t, speed) = np.arange(size.size), states.T
        for i in range(int(size.max(initial=0))):
            on = size[which] > i
            which, t, speed = which[on], t[on], speed[on]
            owner.append(which)
            order.append(np.full(which.size, i))
            tau.append(t)
            v.append(speed)
            t, speed = self.model.states_after_return(steps.take(which), t, speed)
        if not owner:
            return np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
        numbers = np.concatenate(owner)
        sort = np.lexsort((np.concatenate(order), numbers))
        return numbers[sort], np.concatenate(tau)[sort], np.concatenate(v)[sort]
