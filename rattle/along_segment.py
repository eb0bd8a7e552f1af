"""What a bifurcation diagram asks of a model along a segment of its parameters, and what the impacting one answers."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rattle.arclength import Problem
from rattle.attractors.classify import Classifier
from rattle.attractors.table import Attractors
from rattle.branches import Branch, doubled, through
from rattle.errors import RattleError
from rattle.events import Event
from rattle.impacting.attractors.classifier import attractors_of, classify
from rattle.impacting.map.iterate import iterate
from rattle.impacting.orbits.equations import Itinerary, on_line
from rattle.impacting.orbits.period_one import period_one
from rattle.impacting.orbits.periodic import PeriodicOrbit, follow_impacts, orbit_of
from rattle.numerics.complex_step import Array
from rattle.orbits.period_one import NAMES
from rattle.orbits.periodic import Periodic, at_parameters

POINTS_ACROSS = 60  # a segment, at least

Motion = tuple[Any, Array]  # its itinerary; its n unknowns, then the d parameters


@dataclass(frozen=True)
class Segment:
    """From start to end, parameters (d,) with δ and ε first; a position on it is a fraction of the way."""

    start: Array
    end: Array

    @property
    def direction(self) -> Array:
        """End less start."""
        return self.end - self.start

    def at(self, position: NDArray[np.float64]) -> Array:
        """Parameters (…, d) at these positions (…), the ends exactly."""
        found = self.start + np.asarray(position)[..., None] * self.direction
        found[..., 1] = np.maximum(found[..., 1], 0.0)
        return np.asarray(found, np.float64)

    def position(self, parameters: Array) -> Array:
        """Where points (…, d) of the segment are (…)."""
        rate = self.direction
        return np.asarray(np.sum((parameters - self.start) * rate, axis=-1) / (rate @ rate), np.float64)


class Motions(Protocol):
    """One model along a segment. A step is a point of it: δ, ε, β and what else the model has, arrays (n,) for many.

    Branches and events are the model's own: `rattle.Branch` and `rattle.Event` say what is asked of them.
    """

    @property
    def segment(self) -> Segment:
        """The segment."""

    def steps(self, position: Array) -> tuple[Array, ...]:
        """The steps at these positions (n,)."""

    def sampled(self, steps: tuple[Array, ...], count: int, v_max: float, seed: int) -> Attractors:
        """The attractors that so many initial conditions find, cell i at step i."""

    def classify(self, steps: tuple[Array, ...], tau: Array, v: Array) -> Classifier:
        """States (n, k), each followed to its end."""

    def returned(self, steps: tuple[Array, ...], tau: Array, v: Array) -> tuple[Array, Array]:
        """States (n,) after one return to Σ⁺."""

    def period_one(self, steps: tuple[Array, ...]) -> Iterator[Motion]:
        """Motions A to D somewhere on each of their branches."""

    def near(self, step: tuple[float, ...], tau: float, v: float, n_plus: int) -> Motion | None:
        """The periodic motion with so many impacts on Σ⁺ near a state, if there is one."""

    def problem(self, itinerary: Any) -> Problem:
        """The equations of motions with an itinerary; y = (unknowns (n,), position)."""

    def solved(self, itinerary: Any, y: Array) -> Periodic | None:
        """The motion at this position whose unknowns are near those of y."""

    def through(self, motion: Motion, span: tuple[float, float]) -> Any:
        """The branch through a motion, over these positions less its own."""

    def doubled(self, event: Any, span: tuple[float, float]) -> Any:
        """The branch of motions of twice the period from a flip on, over these positions less its own."""

    def events(self, found: Any) -> tuple[Any, ...]:
        """All that happens on a branch."""

    def beside(self, event: Any) -> Iterator[Motion]:
        """The motions, of any itinerary, whose branches pass an event."""


@dataclass(frozen=True)
class ImpactingMotions:
    """The impacting model: see `Motions`."""

    segment: Segment
    beta: float

    def steps(self, position: Array) -> tuple[Array, ...]:
        """See `Motions`."""
        delta, epsilon = np.ascontiguousarray(self.segment.at(position).T)
        return delta, epsilon, np.full_like(delta, self.beta)

    def sampled(self, steps: tuple[Array, ...], count: int, v_max: float, seed: int) -> Attractors:
        """See `Motions`."""
        delta, epsilon, beta = steps
        return attractors_of(delta, epsilon, beta, count, v_max, seed)

    def classify(self, steps: tuple[Array, ...], tau: Array, v: Array) -> Classifier:
        """See `Motions`."""
        delta, epsilon, beta = steps
        return classify(delta, epsilon, beta, tau, v)

    def returned(self, steps: tuple[Array, ...], tau: Array, v: Array) -> tuple[Array, Array]:
        """See `Motions`."""
        delta, epsilon, beta = steps
        moved = iterate(delta, epsilon, tau, v, 1, beta)
        return moved.tau, moved.v

    def period_one(self, steps: tuple[Array, ...]) -> Iterator[Motion]:
        """One of each wherever they begin or end to exist."""
        for k, tau, v in where_period_one(steps):
            found = self.near(tuple(float(x[k]) for x in steps), tau, v, 1)
            if found is not None:
                yield found

    def near(self, step: tuple[float, ...], tau: float, v: float, n_plus: int) -> Motion | None:
        """See `Motions`; None also where rounding does not let it be one."""
        delta, epsilon, beta = step
        try:
            itinerary, x = follow_impacts(delta, epsilon, beta, tau, v, n_plus)
        except RattleError:
            return None
        solved = at_parameters(itinerary, x)
        return None if solved is None else (itinerary, orbit_of(itinerary, solved).unknowns)

    def problem(self, itinerary: Itinerary) -> Problem:
        """See `Motions`."""
        return on_line(itinerary, self.segment.start, self.segment.direction)

    def solved(self, itinerary: Itinerary, y: Array) -> PeriodicOrbit | None:
        """See `Motions`."""
        found = at_parameters(itinerary, np.append(y[:-1], self.segment.at(y[-1])))
        return None if found is None else orbit_of(itinerary, found)

    def through(self, motion: Motion, span: tuple[float, float]) -> Branch:
        """See `Motions`."""
        return through(*motion, self._direction, span, POINTS_ACROSS)

    def doubled(self, event: Event, span: tuple[float, float]) -> Branch:
        """See `Motions`."""
        return doubled(event, self._direction, span, POINTS_ACROSS)

    def events(self, found: Branch) -> tuple[Event, ...]:
        """See `Motions`."""
        return found.events

    def beside(self, event: Event) -> Iterator[Motion]:
        """The motion of the event and, at a graze, the one that misses the wall."""
        yield event.itinerary, event.unknowns
        if event.impact is not None:
            yield event.itinerary.without(event.impact), np.delete(event.unknowns, event.impact)

    @property
    def _direction(self) -> tuple[float, float]:
        delta, epsilon = self.segment.direction
        return float(delta), float(epsilon)


def where_period_one(steps: tuple[Array, ...]) -> Iterator[tuple[int, float, float]]:
    """A to D of the impacting model: step and state of one of each wherever they begin or end to exist."""
    found = period_one(*steps)
    for i in range(len(NAMES)):
        for run in runs(np.flatnonzero(found.exists[i])):
            k = int(run[run.size // 2])
            yield k, float(found.tau[i, k]), float(found.v[i, k])


def runs(steps: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Rising numbers cut where they are not consecutive."""
    return np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1) if steps.size else []
