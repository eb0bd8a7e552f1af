"""Measure the cost of a survey's cells by their distance from the quiet limit, and compare it with an older version.

Cells are drawn at random from the plane of Figure 7. The classes are ranges of ε divided by the quiet limit. The same
number of cells is drawn from each class, and each class is weighted by its share of the plane, because expensive
classes have few cells. The cells of a class are computed at once, like a tile.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.measure import PLANE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

BETA, V_MAX, COUNT, PER_CLASS = 0.6, 7.0, 64, 128
DRAWN, TURNS = 20_000, 3
NAMES = ("below 0.9", "0.9 to 0.98", "0.98 to 1", "1 to 1.2", "above 1.2")
EDGES, WHOLE = (0.9, 0.98, 1.0, 1.2), "the plane"


@dataclass(frozen=True)
class Sampled:
    """The drawn cells (n,) of a class. share: the class' share of all cells of the plane."""

    name: str
    share: float
    delta: NDArray[np.float64]
    epsilon: NDArray[np.float64]


@dataclass(frozen=True)
class Cost:
    """The cost of one cell: milliseconds of processor time, and number of impacts on Σ⁺."""

    milliseconds: float
    impacts: float


@dataclass(frozen=True)
class Reference:
    """Costs by class, measured with another version, for COUNT initial conditions and PER_CLASS cells of each class."""

    version: str
    processor: str
    costs: dict[str, Cost]

    def ratios(self, name: str, cost: Cost) -> tuple[float, float]:
        """Return the impacts and the time of a cell, divided by those of the other version."""
        other = self.costs[name]
        return cost.impacts / other.impacts, cost.milliseconds / other.milliseconds


@dataclass(frozen=True)
class ClassCost:
    """The mean cost of a cell of a class, and the class' shares of the plane's cells, impacts and time."""

    name: str
    cost: Cost
    shares: tuple[float, float, float]


#: Measured with `benchmarks/versions.py`. The impacts are the same on every processor, except for chaotic motions.
F2F9D81 = Reference(
    "f2f9d81",
    "an AMD EPYC (Zen 5)",
    {
        "below 0.9": Cost(0.2498, 3910.7),
        "0.9 to 0.98": Cost(1.4381, 48346.0),
        "0.98 to 1": Cost(9.4416, 473848.8),
        "1 to 1.2": Cost(2.5028, 62939.9),
        "above 1.2": Cost(1.7571, 33544.5),
        WHOLE: Cost(0.9350, 24066.8),
    },
)


def classes(per_class: int = PER_CLASS) -> list[Sampled]:
    """Return `per_class` random cells of each class, always the same cells; fewer if the class has fewer."""
    import rattle

    rng = np.random.default_rng(7)
    delta, epsilon = (rng.uniform(*bounds, DRAWN) for bounds in PLANE)
    number = np.searchsorted(EDGES, epsilon / rattle.quiet_limit(delta), side="right")
    members = [np.flatnonzero(number == i) for i in range(len(NAMES))]
    return [
        Sampled(name, here.size / DRAWN, delta[here[:per_class]], epsilon[here[:per_class]])
        for name, here in zip(NAMES, members, strict=True)
    ]


def taken(cells: Sampled, count: int = COUNT) -> Cost:
    """Measure the mean cost of the cells of a class once."""
    import rattle

    began = time.thread_time()
    found = rattle.attractors_of(cells.delta, cells.epsilon, BETA, count, V_MAX, 0)
    seconds = time.thread_time() - began
    return Cost(seconds / cells.delta.size * 1e3, float(found.impacts.sum()) / cells.delta.size)


def costs(sampled: Sequence[Sampled], count: int = COUNT) -> list[ClassCost]:
    """Return the cost of each class, and last that of the whole plane: the best of TURNS runs after a warm-up."""
    turns = [[taken(each, count) for each in sampled] for _ in range(TURNS + 1)][1:]
    least = [min(each, key=lambda cost: cost.milliseconds) for each in zip(*turns, strict=True)]
    shares = np.array([each.share for each in sampled])
    milliseconds = shares * [cost.milliseconds for cost in least]
    impacts = shares * [cost.impacts for cost in least]
    whole = Cost(float(milliseconds.sum()), float(impacts.sum()))
    of_all = np.transpose([shares, impacts / whole.impacts, milliseconds / whole.milliseconds]).tolist()
    each_class = zip(sampled, least, of_all, strict=True)
    found = [ClassCost(each.name, cost, (cells, hits, time_)) for each, cost, (cells, hits, time_) in each_class]
    return [*found, ClassCost(WHOLE, whole, (1.0, 1.0, 1.0))]
