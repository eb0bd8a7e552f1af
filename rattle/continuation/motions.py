"""The interface between a bifurcation diagram and a model: the model's motions along a segment of parameters."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.classify import Classifier
from rattle.attractors.speeds import SampleSpec
from rattle.attractors.table import AttractorTable, attractors_of_samples
from rattle.continuation.arclength import ContinuationProblem
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic_motions import PeriodicMotion
from rattle.parameters import Parameters

#: Least number of points of a branch that runs along a whole `ParameterSegment`.
POINTS_ACROSS = 60

# a motion: (itinerary, array of the n unknowns followed by the d parameters)
Motion = tuple[Any, Array]


@dataclass(frozen=True)
class ParameterSegment:
    """A segment from `start` to `end`, two points of d parameters, δ and ε first.

    A position is a fraction of the way from start to end.
    """

    start: Array
    end: Array

    @property
    def direction(self) -> Array:
        """The difference end − start."""
        return self.end - self.start

    def parameters_at(self, position: NDArray[np.float64]) -> Array:
        """Return the parameters (…, d) at positions (…): 0 is the start, 1 the end. A negative ε becomes 0."""
        found = self.start + np.asarray(position)[..., None] * self.direction
        found[..., 1] = np.maximum(found[..., 1], 0.0)
        return np.asarray(found, np.float64)

    def position(self, parameters: Array) -> Array:
        """Return the positions (…) of points (…, d) on the segment: 0 for its start, 1 for its end."""
        rate = self.direction
        return np.asarray(np.sum((parameters - self.start) * rate, axis=-1) / (rate @ rate), np.float64)


@dataclass(frozen=True)
class MotionsOnSegment(ABC):
    """The periodic motions of one model along a segment, as a bifurcation diagram needs them.

    A step is a point of the segment. One step is given as {name: value} of its parameters, n steps as `Parameters`
    (n,). Branches and events are classes of the model, with the fields of `rattle.Branch` and `rattle.Event`.
    """

    segment: ParameterSegment
    beta: float

    classifier: ClassVar[type[Classifier]]

    @abstractmethod
    def parameters_of_steps(self, position: Array) -> Parameters:
        """Return the parameters of n steps, given by their positions (n,) along the segment."""

    def sample_attractors(self, steps: Parameters, sample: SampleSpec) -> AttractorTable:
        """Return the attractors that samples of initial conditions reach; cell i of the table is step i."""
        return attractors_of_samples(self.classifier, steps, sample)

    def classify(self, steps: Parameters, tau: Array, v: Array) -> Classifier:
        """Follow states (n, k) until each of them reaches an attractor or its budget ends.

        Parameters
        ----------
        steps : Parameters
            n parameter points.
        tau, v : Array
            Phases and speeds (n, k) of the states; row i is followed at point i.

        Returns
        -------
        Classifier
            The results for all states.
        """
        return self.classifier.classify(steps, tau, v)

    def states_after_return(self, steps: Parameters, tau: Array, v: Array) -> tuple[Array, Array]:
        """Return τ and v (n,) after one return to Σ⁺, of one state at each of the n parameter points `steps`."""
        return self.classifier.states_after_returns(steps, tau, v, 1)[:2]

    @abstractmethod
    def period_one_motions(self, steps: Parameters) -> Iterator[Motion]:
        """Yield motions A to D at some of the steps, so that the diagram can follow their branches from them.

        Each branch of A to D that can be found has at least one of these motions on it.
        """

    @abstractmethod
    def find_motion_near(self, step: Mapping[str, float], tau: float, v: float, n_plus: int) -> Motion | None:
        """Return the periodic motion with n_plus impacts on Σ⁺ near the state (τ, v), or None if there is none.

        step: the parameter point, as {name: value}.
        """

    @abstractmethod
    def equations_along_segment(self, itinerary: Any) -> ContinuationProblem:
        """Return the equations of motions with an itinerary, in y = (unknowns (n,), position along the segment)."""

    @abstractmethod
    def solve_motion(self, itinerary: Any, y: Array) -> PeriodicMotion | None:
        """Return the motion near a guess y = (unknowns (n,), position along the segment), at the same position.

        None means that Newton's method found no motion.
        """

    @abstractmethod
    def follow_branch(self, motion: Motion, span: tuple[float, float]) -> Any:
        """Return the branch that contains a motion.

        span: the range of positions of the branch, relative to the position of the motion.
        """

    @abstractmethod
    def follow_doubled_branch(self, event: Any, span: tuple[float, float]) -> Any:
        """Return the branch of doubled period that starts at a flip `event`.

        span: the range of positions of this branch, relative to the position of the flip.
        """

    @abstractmethod
    def events_of(self, found: Any) -> tuple[Any, ...]:
        """Return all events on a branch `found` of this model."""

    @abstractmethod
    def motions_at_event(self, event: Any) -> Iterator[Motion]:
        """Yield one motion of each branch that passes through an event, also of branches with another itinerary."""


def split_into_consecutive_runs(steps: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Split an array of rising integers into runs of consecutive integers."""
    return np.split(steps, np.flatnonzero(np.diff(steps) > 1) + 1) if steps.size else []
