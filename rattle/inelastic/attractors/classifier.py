"""Find the attractors of samples of the inelastic gear, by the stages of `rattle.attractors.classify`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.ball import Centres, enlarge_one_by_one
from rattle.attractors.classify import BUDGET, Classifier, Seen
from rattle.attractors.samples import Trajectories
from rattle.attractors.speeds import SampleSpec, SpeedLimit
from rattle.attractors.table import AttractorTable, of_samples
from rattle.families.join import cells_between
from rattle.inelastic.attractors.settle import CONTACT, ContactStates, label_contacts, measure, resolve_contacts, settle
from rattle.inelastic.given import Harmonics, checked_harmonics, inelastic_points
from rattle.inelastic.map.cells import InelasticCells, cells_with, inelastic_cells
from rattle.inelastic.map.iterate import returned_states
from rattle.parameters import Parameters


def cells_of(parameters: Parameters) -> InelasticCells:
    """Return cells with these parameters (n,), as kernels take them."""
    added = parameters.added["restitution"], parameters.added["load"]
    return inelastic_cells(parameters.delta, parameters.epsilon, parameters.beta, *added, parameters.harmonics)


@cells_between.register
def _(
    cells: InelasticCells, here: NDArray[np.int64], there: NDArray[np.int64], share: NDArray[np.float64]
) -> InelasticCells:
    """Cells on the way find the zeros of their contact force anew."""
    given = (cells.delta, cells.epsilon, cells.beta, cells.restitution, cells.load)
    delta, epsilon, beta, restitution, load = (
        (x[here, None] * (1.0 - share) + x[there, None] * share).ravel() for x in given
    )
    return cells_with(delta, epsilon, beta, restitution, load, cells.shape)


class InelasticClassifier(Classifier):
    """The samples of a block of cells on their way, and what is known of the cells."""

    def __init__(
        self, cells: InelasticCells, tau: NDArray[np.float64], v: NDArray[np.float64], budget: int = BUDGET
    ) -> None:
        """Begin as the classifier of any gear, with no contact phases known."""
        room = len(cells.delta), cells.zeros.shape[1]  # a state for each release at most
        self.states = ContactStates(
            np.zeros(room[0], np.int64), np.zeros(room), np.zeros(room), np.zeros(room, np.int64)
        )
        super().__init__(cells, tau, v, budget)

    model = "inelastic"
    cells_of = staticmethod(cells_of)

    @staticmethod
    def iterated(
        parameters: Parameters, tau: NDArray[np.float64], v: NDArray[np.float64], returns: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """See `Classifier`."""
        cells, quiet = cells_of(parameters), np.zeros(tau.size, np.int8)
        tau, v, cell = tau.copy(), v.copy(), np.zeros(tau.size, np.int64)
        if parameters.size > 1:
            cell = np.arange(tau.size)
        counts = (np.zeros(tau.size, np.int64) for _ in range(3))
        returned_states(tau, v, np.full(tau.size, returns), cell, cells, quiet, *counts, np.zeros(tau.size))
        return tau, v, quiet > 0

    @staticmethod
    def quiet_invariant(parameters: Parameters) -> float:  # noqa: ARG004
        """No speed above 0 is known beforehand to become quiet: each impact tells."""
        return 0.0

    @property
    def has_quiet(self) -> NDArray[np.bool_]:
        """Return whether the cells (n_cells,) have a quiet motion: the contact force is positive throughout."""
        return np.asarray((self.cells.zero_count == 0) & (self.cells.positive == 1))

    @property
    def has_slow_transients(self) -> NDArray[np.bool_]:
        """Return the flags of the cells (n_cells,) whose impacts lose energy, beside those of any gear."""
        return np.asarray(super().has_slow_transients | (self.cells.restitution < 1.0))

    def enter_known_orbits(self) -> None:
        """No motion is known beforehand."""

    def grow_balls(self) -> None:
        """Count the contact phases of new orbits, then grow their balls of capture."""
        label_contacts(self.grown, self.cells, self.orbits.for_kernels())
        super().grow_balls()

    def resolve(self, which: NDArray[np.int64], samples: Trajectories) -> None:
        """Find the orbits of recurrent samples: exactly where they recur after contact, else by Newton's method."""
        exact = samples.pause[which] == CONTACT
        waiting = which[exact]
        while waiting.size:
            left = np.zeros_like(waiting)
            tables = samples.for_kernels(), self.orbits.for_kernels(), self.balls.for_kernels()
            waiting = left[: resolve_contacts(waiting, self.cells, *tables, self.states, left)]
            self.grow_balls()
            if waiting.size:
                self.make_room(2 * self.orbits.m.shape[1])
        super().resolve(which[~exact], samples)

    def enlarge(self, centres: Centres) -> None:
        """Find the radii of these balls of capture; orbits with contact need none, as their states tell."""
        centres.radius[self.orbits.first[centres.cell, centres.orbit] == -np.inf] = 0.0
        enlarge_one_by_one(centres, self.cells)

    def advance(self, which: NDArray[np.int64], samples: Trajectories, early: bool) -> None:  # noqa: ARG002
        """Follow these samples to their ends or limits: every return is looked at, early or not."""
        settle(which, self.cells, samples.for_kernels(), self.balls.for_kernels(), self.states)

    def watch(
        self, which: NDArray[np.int64], least: NDArray[np.float64], periods: NDArray[np.float64], seen: Seen
    ) -> None:
        """Follow these of the survey's samples with a tangent vector."""
        tables = self.samples.for_kernels(), self.balls.for_kernels(), self.states
        measure(which, least, periods, self.cells, *tables, seen.sums, seen.prints)


def attractors_of(
    delta: ArrayLike,
    epsilon: ArrayLike,
    beta: ArrayLike = 0.6,
    restitution: ArrayLike = 1.0,
    load: ArrayLike = 0.0,
    harmonics: Harmonics = (),
    count: int = 256,
    v_max: SpeedLimit = None,
    seed: int = 0,
    budget: int = BUDGET,
    tau: tuple[float, float] = (0.0, 1.0),
    v_min: float = 0.0,
) -> AttractorTable:
    """Return the attractors of many cells at once, as `rattle.attractors_of` does for elastic impacts.

    Parameters
    ----------
    delta, epsilon, beta, restitution, load : array_like
        The parameters of the cells, which broadcast: see `rattle.Gear`.
    harmonics : sequence of (int, float, float)
        The harmonics beside the first, the same for all cells: see `rattle.Gear`.
    count, v_max, seed, budget, tau, v_min
        The sample of each cell, as in `rattle.attractors_of`.

    Returns
    -------
    AttractorTable
        Cell by cell; those of a cell do not depend on the other cells.

    Raises
    ------
    ParameterError
        A parameter is outside its domain.
    """
    cells = inelastic_points(delta, epsilon, beta, restitution, load, checked_harmonics(harmonics))
    return of_samples(InelasticClassifier, cells, SampleSpec(count, v_max, seed, budget, tau, v_min))
