"""Which attractors the samples of cells of the stiff gear go to, by the stages of `rattle.attractors.classify`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.ball import Centres, enlarge_one_by_one
from rattle.attractors.classify import BUDGET, Classifier, Seen
from rattle.attractors.samples import Samples
from rattle.attractors.speeds import SpeedLimit
from rattle.attractors.table import Attractors, of_samples
from rattle.errors import parameters
from rattle.numerics.compile import compile_apart
from rattle.stiff.attractors.settle import StiffCells, measure, settle
from rattle.stiff.map.quiet import quiet_limit


class StiffClassifier(Classifier):
    """The samples of a block of cells on their way, and what is known of the cells."""

    @property
    def has_quiet(self) -> NDArray[np.bool_]:
        """Whether the cells (n_cells,) have a quiet motion."""
        return np.asarray(self.cells.has_quiet > 0)

    def enter_known_orbits(self) -> None:
        """No motion is known beforehand."""

    def enlarge(self, centres: Centres) -> None:
        """Find the radii of these balls of capture."""
        enlarge_one_by_one(centres, self.cells)

    def advance(self, which: NDArray[np.int64], samples: Samples, early: bool) -> None:  # noqa: ARG002
        """Follow these samples to their ends or limits: every return is looked at, early or not."""
        settle(which, self.cells, samples, self.balls)

    def watch(
        self, which: NDArray[np.int64], least: NDArray[np.float64], periods: NDArray[np.float64], seen: Seen
    ) -> None:
        """Follow these of the survey's samples with a tangent vector."""
        measure(which, least, periods, self.cells, self.samples, self.balls, *seen)


def cells_of(
    delta: NDArray[np.float64], epsilon: NDArray[np.float64], beta: NDArray[np.float64], kappa: NDArray[np.float64]
) -> StiffCells:
    """Cells with these parameters (n,), as kernels take them."""
    rests = np.where(epsilon < quiet_limit(delta, kappa), 1.0, 0.0)
    return StiffCells(delta, epsilon, beta, rests, kappa)


def classify(
    delta: NDArray[np.float64],
    epsilon: NDArray[np.float64],
    beta: NDArray[np.float64],
    kappa: NDArray[np.float64],
    tau: NDArray[np.float64],
    v: NDArray[np.float64],
    budget: int = BUDGET,
) -> StiffClassifier:
    """The samples (τ, v) of shape (n, count) of cells with parameters (n,), each followed to its end or its budget."""
    compile_apart("rattle.precompile", "survey", "stiff")
    found = StiffClassifier(cells_of(delta, epsilon, beta, kappa), tau, v, budget)
    found.run()
    return found


def attractors_of(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: ArrayLike,
    kappa: ArrayLike,
    count: int = 256,
    v_max: SpeedLimit = None,
    seed: int = 0,
    budget: int = BUDGET,
    tau: tuple[float, float] = (0.0, 1.0),
    v_min: float = 0.0,
) -> Attractors:
    """The attractors of all cells at once, as `rattle.attractors_of`: the parameters broadcast, the samples are the
    same. A cell's are those of `StiffGear.attractors` to the bit, whatever the other cells are. Raises ParameterError.
    """
    return of_samples(classify, parameters(delta, epsilon, beta, kappa=kappa), count, v_max, seed, budget, tau, v_min)
