"""Interface between a bifurcation diagram and a model along a segment of its parameters."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.classify import Classifier
from rattle.attractors.speeds import SampleSpec
from rattle.attractors.table import AttractorTable, of_samples
from rattle.continuation.arclength import ContinuationProblem
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic import Periodic
from rattle.parameters import Parameters

POINTS_ACROSS = 60  # a segment, at least

Motion = tuple[Any, Array]  # its itinerary; its n unknowns, then the d parameters


@dataclass(frozen=True)
class Segment:
    """A segment from `start` to `end`, parameters (d,) with δ and ε first; positions on it are fractions of the way."""

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
        """Return the positions (…) of points (…, d) on the segment."""
        rate = self.direction
        return np.asarray(np.sum((parameters - self.start) * rate, axis=-1) / (rate @ rate), np.float64)


@dataclass(frozen=True)
class Motions(ABC):
    """The periodic motions of one model along a segment, as a bifurcation diagram needs them.

    A step is a point of the segment, its parameters by name; many steps are `Parameters` (n,). Branches and events are
    the model's own: `rattle.Branch` and `rattle.Event` say what is asked of them.
    """

    segment: Segment
    beta: float

    classifier: ClassVar[type[Classifier]]

    @abstractmethod
    def steps(self, position: Array) -> Parameters:
        """Return the steps at these positions (n,)."""

    def sampled(self, steps: Parameters, sample: SampleSpec) -> AttractorTable:
        """Return the attractors that a sample finds, cell i at step i."""
        return of_samples(self.classifier, steps, sample)

    def classify(self, steps: Parameters, tau: Array, v: Array) -> Classifier:
        """States (n, k), each followed to its end."""
        return self.classifier.classify(steps, tau, v)

    def returned(self, steps: Parameters, tau: Array, v: Array) -> tuple[Array, Array]:
        """States (n,) after one return to Σ⁺."""
        return self.classifier.iterated(steps, tau, v, 1)[:2]

    @abstractmethod
    def period_one(self, steps: Parameters) -> Iterator[Motion]:
        """Motions A to D somewhere on each of their branches."""

    @abstractmethod
    def near(self, step: Mapping[str, float], tau: float, v: float, n_plus: int) -> Motion | None:
        """Return the periodic motion with so many impacts on Σ⁺ near a state, if there is one."""

    @abstractmethod
    def problem(self, itinerary: Any) -> ContinuationProblem:
        """Return the equations of motions with an itinerary; y = (unknowns (n,), position)."""

    @abstractmethod
    def solved(self, itinerary: Any, y: Array) -> Periodic | None:
        """Return the motion at this position whose unknowns are near those of y."""

    @abstractmethod
    def through(self, motion: Motion, span: tuple[float, float]) -> Any:
        """Return the branch through a motion, over these positions less its own."""

    @abstractmethod
    def doubled(self, event: Any, span: tuple[float, float]) -> Any:
        """Return the branch of motions of twice the period from a flip on, over these positions less its own."""

    @abstractmethod
    def events(self, found: Any) -> tuple[Any, ...]:
        """Return all that happens on a branch."""

    @abstractmethod
    def beside(self, event: Any) -> Iterator[Motion]:
        """Return the motions, of any itinerary, whose branches pass an event."""


def runs(steps: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Rising numbers cut where they are not consecutive."""
    return np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1) if steps.size else []
