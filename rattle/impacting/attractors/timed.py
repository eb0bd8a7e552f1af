"""Where the time of cells goes: the classifier with a clock in its kernels, whose results are the same bits.

A kernel is timed from one set of flights to the next, some ten thousandths of a second each, and the flights that its
lanes make and could make are counted. The clock is that of the wall; of the kernel's processor time every part has the
share that it has of the kernel's wall time, so that other programs do not count.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.classify import Seen
from rattle.attractors.samples import Samples
from rattle.attractors.table import of_samples
from rattle.errors import parameters
from rattle.flight.lanes.block import GROUP, GROUPS, NONE, empty, made_ready, roughest
from rattle.flight.lanes.stages import advance
from rattle.impacting.attractors.classifier import ImpactingClassifier, cells_of
from rattle.impacting.attractors.settle import (
    CHUNK,
    LONG_CHUNK,
    STRIDES,
    Watch,
    leave_footprints,
    looked_round,
    watched_round,
)
from rattle.impacting.map.iterate import iterate, iterate_tangent
from rattle.numerics.clock import nanoseconds
from rattle.numerics.compile import inline, kernel

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from rattle.attractors.table import Attractors

LOOKS, FLIGHTS, FLOWN, OFFERED = range(4)  # of a meter: nanoseconds, then flights of lanes in use and of all lanes
IMPACTS, TURNS = 128, 3  # that the same states make without and with a tangent vector, to compare


class Parts(NamedTuple):
    """Seconds of the processor, that add up to the whole: flights of samples; looks at the lanes between flights, with
    what is recorded and refilled there; flights' time of lanes that have no sample or one that has made its impacts;
    what flights with a tangent vector take more than without; orbits found by Newton's method from samples that recur;
    the rest, in Python and in what is known beforehand of cells.
    """

    flights: float
    looks: float
    idle: float
    tangent: float
    newton: float
    rest: float


@inline
def flown(b, groups):
    """Flights that the lanes have made with what they carry."""
    n = 0.0
    for i in range(GROUP * groups):
        n += b.n_plus[i] + b.n_minus[i]
    return int(n)


@kernel
def timed_settle(memory, which, flights, cells, samples, balls, paths, meter):
    """`settle`, and what it takes."""
    b, fresh, groups, room = memory[0], NONE, GROUPS, np.empty(2, np.int64)
    empty(b)
    while groups > 0:
        began = nanoseconds(room)
        fresh = looked_round(b, groups, fresh, which, cells, samples, balls)
        groups = made_ready(b, groups, fresh == which.size)
        force = roughest(b, groups)
        meter[LOOKS] += nanoseconds(room) - began
        meter[FLOWN] -= flown(b, groups)
        began = nanoseconds(room)
        advance(memory, groups, flights, force, False, paths)
        meter[FLIGHTS] += nanoseconds(room) - began
        meter[FLOWN] += flown(b, groups)
        meter[OFFERED] += GROUP * groups * flights


@kernel
def timed_measure(memory, which, cells, samples, balls, watch, paths, meter):
    """`measure`, and what it takes."""
    b, fresh, groups, room = memory[0], NONE, GROUPS, np.empty(2, np.int64)
    empty(b)
    while groups > 0:
        began = nanoseconds(room)
        fresh = watched_round(b, groups, fresh, which, cells, samples, balls, watch)
        groups = made_ready(b, groups, fresh == which.size)
        force = roughest(b, groups)
        meter[LOOKS] += nanoseconds(room) - began
        meter[FLOWN] -= flown(b, groups)
        for flights in STRIDES:
            began = nanoseconds(room)
            advance(memory, groups, flights, force, True, paths)
            looked = nanoseconds(room)
            leave_footprints(b, groups, watch.footprints)
            meter[FLIGHTS] += looked - began
            meter[LOOKS] += nanoseconds(room) - looked
            meter[OFFERED] += GROUP * groups * flights
        meter[FLOWN] += flown(b, groups)


class TimedClassifier(ImpactingClassifier):
    """The classifier, that knows what its parts took."""

    def __init__(self, *arguments: Any) -> None:
        """As the classifier."""
        self._meters = np.zeros((2, 4), np.int64)  # without tangent, with
        self._seconds = np.zeros(3)  # of the kernels without and with tangent, of the search for orbits
        self._witnesses: list[tuple[NDArray[np.float64], ...]] = []
        super().__init__(*arguments)

    def _timed(self, part: int, run: Callable[..., Any], *arguments: Any) -> None:
        began = time.thread_time()
        run(*arguments)
        self._seconds[part] += time.thread_time() - began

    def advance(self, which: NDArray[np.int64], samples: Samples, early: bool) -> None:
        """See `Classifier`."""
        flights, meter, which = CHUNK if early else LONG_CHUNK, self._meters[0], self.alike(which, samples)
        self._timed(0, timed_settle, self._block, which, flights, self.cells, samples, self.balls, self.paths, meter)

    def watch(
        self, which: NDArray[np.int64], least: NDArray[np.float64], periods: NDArray[np.float64], seen: Seen
    ) -> None:
        """See `Classifier`."""
        cell, tau, v = (x[which] for x in (self.samples.cell, self.samples.tau, self.samples.v))
        self._witnesses.append((self.cells.delta[cell], self.cells.epsilon[cell], tau, v, self.cells.beta[cell]))
        watch = Watch(least, periods, *seen)
        arguments = (self._block, which, self.cells, self.samples, self.balls, watch, self.paths, self._meters[1])
        self._timed(1, timed_measure, *arguments)

    def resolve(self, which: NDArray[np.int64], samples: Samples) -> None:
        """See `Classifier`."""
        self._timed(2, super().resolve, which, samples)

    def parts(self, whole: float) -> Parts:
        """Where so many seconds of the processor went that the classification took."""
        clock = self._meters[:, [LOOKS, FLIGHTS]].astype(float)
        seconds = self._seconds[:2, None] * clock / np.maximum(clock.sum(axis=1, keepdims=True), 1.0)
        busy = seconds[:, 1] * self._meters[:, FLOWN] / np.maximum(self._meters[:, OFFERED], 1)
        tangent = float(busy[1]) * self.tangent_share()
        return Parts(
            flights=float(busy.sum()) - tangent,
            looks=float(seconds[:, 0].sum()),
            idle=float((seconds[:, 1] - busy).sum()),
            tangent=tangent,
            newton=float(self._seconds[2]),
            rest=whole - float(self._seconds.sum()),
        )

    def tangent_share(self) -> float:
        """Of a flight with a tangent vector, how much is due to that: the witnesses' states flown without and with."""
        if not self._witnesses:
            return 0.0
        delta, epsilon, tau, v, beta = (np.concatenate(x) for x in zip(*self._witnesses, strict=True))
        taken = np.zeros((TURNS + 1, 2))
        for turn in taken:
            for i, run in enumerate((iterate, iterate_tangent)):
                began = time.thread_time()
                run(delta, epsilon, tau, v, IMPACTS, beta)
                turn[i] = time.thread_time() - began
        plain, tangent = taken[1:].min(axis=0)  # the first turn may have compiled
        return float(max(1.0 - plain / tangent, 0.0))


def timed_attractors(
    delta: ArrayLike, epsilon: ArrayLike, beta: ArrayLike, count: int, v_max: float
) -> tuple[Attractors, Parts]:
    """`attractors_of` these cells with seed 0, and the seconds of the processor that its parts took."""
    made: list[TimedClassifier] = []

    def classify(*arguments: Any) -> TimedClassifier:
        *cell, tau, v, budget = arguments
        made.append(TimedClassifier(cells_of(*cell), tau, v, budget))
        made[0].run()
        return made[0]

    began = time.thread_time()
    table = of_samples(classify, parameters(delta, epsilon, beta), count, v_max, 0)
    return table, made[0].parts(time.thread_time() - began)
