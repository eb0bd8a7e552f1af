"""Attractors along a path of parameters: which there are at each step, with their shares, and why they come and go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.reached import states_of
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import MOST_SAMPLES, SampleSpec, SpeedLimit
from rattle.attractors.table import KINDS, Attractor, AttractorTable, tabulated
from rattle.errors import require
from rattle.flight.law import wrapped
from rattle.models import MODELS, AnyGear, gear_at, model_at
from rattle.numerics.sampling import wilson_interval
from rattle.parameters import Parameters
from rattle.resilience.accumulate import Make, accumulated_at
from rattle.resilience.causes import CONTINUES, CRISIS, QUIET_LIMIT, SAMPLING, UNKNOWN, OrbitEnd, TrackedOrbit, end_of
from rattle.resilience.gears import States, path_points, unit_of

Array = NDArray[np.float64]
NOTHING: Mapping[str, Make] = MappingProxyType({})
PERIODS = 200.0  # for which quantities are gathered by default
CHAOTIC_STATES = 16  # of a chaotic attractor, that are followed at the next step
SAME_POINT = 1e-6
CHAOS_THERE = -2  # a motion is chaotic where no sample was


class Change(NamedTuple):
    """A family that begins or ends between two steps of a path.

    step: the last one before; begins: it is there after it, and not before. cause: saddle-node, flip, graze, crisis,
    quiet limit; sampling: it is there on both sides, and no sample of one went to it; continues: it is there as the
    family `other`; unknown. low, high: between which
    positions, steps and parts of them. other: the family that a motion on it goes to where it is not, −1 if unknown.
    """

    family: int
    step: int
    begins: bool
    cause: str
    low: float
    high: float
    other: int


@dataclass(frozen=True, eq=False)
class GlobalContinuation:
    """The attractors of the steps of a path, joined from step to step.

    parameters (n, 3 or more): δ, ε, β and what the model adds. count: samples of a step. attractors: of all steps,
    whose numbers are their cells, with orbits that samples of a step missed and its neighbours know, of samples 0.
    family (rows,): 0 quiet, −1 undecided; entered (rows,): whether only a neighbour knew it. changes: in their order
    along the path. quantities: what was gathered of each sample, (n, count). which (n, count): the row of the attractor
    that a sample goes to.
    """

    parameters: Array
    count: int
    attractors: AttractorTable
    entered: NDArray[np.bool_]
    family: NDArray[np.int64]
    which: NDArray[np.int64]
    changes: tuple[Change, ...]
    quantities: Mapping[str, Array]

    @property
    def families(self) -> tuple[int, ...]:
        """The numbers of the families, quiet motion first, then by falling number of steps."""
        return tuple(int(x) for x in np.unique(self.family) if x >= 0)

    def label(self, number: int) -> tuple[str, int, int, int]:
        """Kind, m, n₊ and n₋ of a family."""
        row = self._rows(number)[0]
        return KINDS[self.attractors.kind[row]], *self.attractors.label(row)

    def fractions(self, number: int) -> Array:
        """Return the share of the samples that a family wins at each step (n,); NaN where it is not."""
        won = self._won(number)
        return np.where(won >= 0, won / self.count, np.nan)

    def intervals(self, number: int) -> tuple[Array, Array]:
        """Return the ends of the 95 % Wilson intervals of these shares (n,)."""
        won = self._won(number)
        low, high = wilson_interval(np.maximum(won, 0), self.count)
        return np.where(won >= 0, low, np.nan), np.where(won >= 0, high, np.nan)

    def means(self, name: str, number: int) -> tuple[Array, Array]:
        """Return the mean of a quantity over the samples of a family at each step (n,), and its standard error."""
        mine = np.isin(self.which, self._rows(number))
        values = np.where(mine, self.quantities[name], 0.0)
        known = np.where(mine, ~np.isnan(self.quantities[name]), False)
        values, many = np.where(known, values, 0.0), known.sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = values.sum(axis=1) / many
            spread = np.where(known, (self.quantities[name] - mean[:, None]) ** 2, 0.0).sum(axis=1)
            return mean, np.sqrt(spread / (many - 1) / many)

    def _rows(self, number: int) -> NDArray[np.int64]:
        rows = np.flatnonzero(self.family == number)
        require(rows.size > 0, f"there is no family {number}: there are {', '.join(map(str, self.families))}")
        return rows

    def _won(self, number: int) -> NDArray[np.int64]:
        """Return the samples at each step (n,), −1 where the family is not."""
        rows = self._rows(number)
        cell, n = self.attractors.cell[rows], len(self.parameters)
        won = np.bincount(cell, self.attractors.samples[rows], n).astype(np.int64)
        return np.where(np.bincount(cell, minlength=n) > 0, won, -1)


def global_continuation(
    path: ArrayLike,
    count: int = 256,
    steps: int | None = None,
    beta: float = 0.6,
    v_max: SpeedLimit = None,
    seed: int = 0,
    causes: bool = True,
    quantities: Mapping[str, Make] = NOTHING,
    periods: float = PERIODS,
    states: States = None,
    **added: float | None,
) -> GlobalContinuation:
    """Return the attractors along a path of parameters, points (k, 2 or more).

    The points are of (δ, ε), of (δ, ε, β) or of these with the parameters that a model adds.

    Each stable orbit is itself continued to the next steps, so that these have what their samples missed; chaotic
    attractors are one where they visit the same states (docs/families.md). Of each family that begins or ends the cause
    is told, unless causes is False: its orbit is followed from step to step.

    Parameters
    ----------
    count, v_max, seed
        The sample of each step, as in `Gear.attractors`.
    steps : int | None
        So many even ones along the path; by default its own points are the steps. beta, and what a model adds by its
        name, such as the stiffness of the stiff gear: where the path has none.
    quantities : Mapping[str, Make]
        What else to gather of each sample, by name, over so many forcing periods (`Accumulator`).
    states : States
        Own ones (τ, v) of every step instead.

    Returns
    -------
    GlobalContinuation
        The attractors and their basin fractions.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    points = path_points(path, beta, added, steps)
    given = None if states is None else states_of(*states)
    sample = SampleSpec(count if given is None else given[0].size, v_max, seed)
    count = sample.count
    require(points.size * count <= 64 * MOST_SAMPLES, f"{points.size} steps of {count} samples are too many at once")
    tau, v = sample.states(points) if given is None else (np.tile(x, (points.size, 1)) for x in given[:2])
    model = MODELS[points.model]
    table, row = tabulated(model.classified(points, tau.copy(), v.copy()), missed=True)
    attractors, entered, family = model.joined_rows(points, table)
    which = np.flatnonzero(~entered)[row].reshape(-1, count)
    every = points.repeat(count)
    gathered = {
        name: accumulated_at(every, tau.ravel(), v.ravel(), make(), periods).reshape(-1, count)
        for name, make in quantities.items()
    }
    found = _Changes(points, attractors, family).all() if causes else ()
    rows = np.stack(list(points.named.values()), axis=1)
    return GlobalContinuation(rows, count, attractors, entered, family, which, tuple(found), gathered)


class _Changes:
    """Begins and ends of families along a path, and their causes."""

    def __init__(self, points: Parameters, attractors: AttractorTable, family: NDArray[np.int64]) -> None:
        self.points, self.rows, self.family = points, attractors, family
        n = points.size
        self.here = [{int(family[i]): int(i) for i in reversed(self._at(step))} for step in range(n)]

    def _at(self, step: int) -> NDArray[np.int64]:
        return np.flatnonzero((self.rows.cell == step) & (self.family >= 0))

    def all(self) -> list[Change]:
        """Return all of them, along the path; those of chaos, which may follow from others, are told last."""
        found = [
            (family, step, begins)
            for step in range(self.points.size - 1)
            for begins in (False, True)
            for family in sorted(self.here[step + begins].keys() - self.here[step + 1 - begins].keys())
        ]
        told: dict[tuple[int, int, bool], Change] = {}
        for chaotic in (False, True):
            for each in found:
                if (self.rows.kind[self._row(*each)] == Outcome.CHAOTIC) == chaotic:
                    told[each] = self._told(*each, told)
        return sorted(told.values(), key=lambda change: (change.step, change.low, change.family))

    def _row(self, family: int, step: int, begins: bool) -> int:
        return self.here[step + begins][family]

    def _told(self, family: int, step: int, begins: bool, others: dict[tuple[int, int, bool], Change]) -> Change:
        row, where, away = self._row(family, step, begins), step + begins, step + 1 - begins
        kind, gears = self.rows.kind[row], (gear_at(self.points, where), gear_at(self.points, away))
        end = OrbitEnd(UNKNOWN, 0.0, 1.0)
        if kind == Outcome.QUIET:
            limited = gears[1].epsilon >= gears[1].quiet_limit
            return self._change(family, step, begins, OrbitEnd(QUIET_LIMIT if limited else SAMPLING, 0.0, 1.0), -1)
        other = self._goes_to(row, away, *gears)
        if kind == Outcome.PERIODIC:
            orbit = TrackedOrbit(self.rows.label(row), float(self.rows.tau[row]), float(self.rows.v[row]))
            end = end_of(self.points.take([where]), self.points.take([away]), orbit)
            if end.orbit is not None and (goes_on := self._listed(end.orbit, away, gears[1])) >= 0:
                end, other = OrbitEnd(CONTINUES, 0.0, 1.0), goes_on
        elif other in self.here[where]:
            end = OrbitEnd(CRISIS, 0.0, 1.0)
        elif (because := others.get((other, step, not begins))) is not None:
            return Change(family, step, begins, *because[3:6], other)
        elif other >= 0:
            end = OrbitEnd(CRISIS, 0.0, 1.0)  # of chaos into chaos that visits other states
        elif other == CHAOS_THERE:
            end, other = OrbitEnd(SAMPLING, 0.0, 1.0), -1
        return self._change(family, step, begins, end, other)

    def _change(self, family: int, step: int, begins: bool, end: OrbitEnd, other: int) -> Change:
        low, high = (step + 1 - end.high, step + 1 - end.low) if begins else (step + end.low, step + end.high)
        return Change(family, step, begins, end.cause, float(low), float(high), other)

    def _goes_to(self, row: int, step: int, gear: AnyGear, there: AnyGear) -> int:
        """Return the family at a step that most states of an attractor go to.

        Returns
        -------
        int
            Number of the family, CHAOS_THERE if the motion is chaotic and has none, −1 if none is known.
        """
        tau, v = float(self.rows.tau[row]), float(self.rows.v[row])
        if self.rows.kind[row] == Outcome.CHAOTIC and model_at(there).rests_late(there.delta, there.epsilon):
            return -1  # what is on its way to rest there makes impacts without end
        many = CHAOTIC_STATES if self.rows.kind[row] == Outcome.CHAOTIC else 1
        on = gear.iterate(tau, v, 7 * np.arange(many))
        goes = there.reached(on.tau, on.v).attractors[0]
        for family, other in self.here[step].items():
            if self._is(goes, other, unit_of(there)):
                return family
        return CHAOS_THERE if goes.kind == KINDS[Outcome.CHAOTIC] else -1

    def _listed(self, orbit: TrackedOrbit, step: int, gear: AnyGear) -> int:
        """Return the family at a step that an orbit belongs to, −1 if it is not listed there."""
        all_of_it = gear.iterate(orbit.tau, orbit.v, np.arange(orbit.label[1]))
        for family, row in self.here[step].items():
            if self.rows.label(row) == orbit.label:
                far = abs(wrapped(all_of_it.tau - self.rows.tau[row]))
                far = np.maximum(far, abs(all_of_it.v - self.rows.v[row]) / unit_of(gear))
                if far.min() < SAME_POINT:
                    return family
        return -1

    def _is(self, goes: Attractor, row: int, unit: float) -> bool:
        label = KINDS[self.rows.kind[row]], *self.rows.label(row)
        if label != (goes.kind, goes.m, goes.n_plus, goes.n_minus):
            return False
        far = abs(wrapped(goes.tau - self.rows.tau[row])), abs(goes.v - self.rows.v[row]) / unit
        return bool(self.rows.kind[row] != Outcome.PERIODIC or max(far) < SAME_POINT)
