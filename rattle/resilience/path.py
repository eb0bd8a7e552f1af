"""Global continuation: the attractors at each step of a path of parameters, and why they begin and end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.reached import check_and_flatten_states
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import MOST_SAMPLES, SampleSpec, SpeedLimit
from rattle.attractors.table import KINDS, Attractor, AttractorTable, tabulate_attractors
from rattle.errors import require
from rattle.flight.law import wrap_phase_difference
from rattle.models import MODELS, AnyGear, gear_at_point, model_of_gear
from rattle.numerics.sampling import wilson_interval
from rattle.parameters import Parameters
from rattle.resilience.accumulate import Make, accumulate_at_parameters
from rattle.resilience.causes import (
    CONTINUES,
    CRISIS,
    QUIET_LIMIT,
    SAMPLING,
    UNKNOWN,
    OrbitEnd,
    TrackedOrbit,
    find_orbit_end,
)
from rattle.resilience.gears import States, points_along_path, speed_unit_of

Array = NDArray[np.float64]
NOTHING: Mapping[str, Make] = MappingProxyType({})
#: Default of `periods`, the forcing periods over which quantities are accumulated.
PERIODS = 200.0
#: Number of states of a chaotic attractor that are followed at the next step.
CHAOTIC_STATES = 16
#: States of two periodic attractors are the same if τ and v differ by less than this, v in units of `speed_unit_of`.
SAME_POINT = 1e-6
#: Stands for the number of a family if a motion becomes chaotic at a step that has no chaotic family in the table.
CHAOS_THERE = -2


class FamilyChange(NamedTuple):
    """The beginning or the end of a family between two steps of a path.

    family: the number of the family. step: the change is between the steps `step` and `step` + 1.
    begins: True if the family begins, False if it ends.
    cause: "saddle-node", "flip", "graze", "crisis", "quiet limit" or "unknown". "sampling": the attractor exists at
    both steps, but the samples of one step missed it. "continues": the attractor exists at both steps, and has the
    number `other` at the step that lacks the number `family`.
    low, high: the change is between these positions along the path, in steps and fractions of a step.
    other: the family to which motions on the attractor go at the step that lacks `family`, −1 if unknown.
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
    """The attractors at the n steps of a path, joined to families from step to step.

    parameters (n, 3 or more): δ, ε, β and the parameters that the model adds.
    count: the number of samples at each step.
    attractors: the attractors of all steps, one in each row; `cell` is the number of the step. Orbits that no sample
    reached, but that were continued from a neighbouring step, have 0 samples. entered (rows,): True if the attractor
    was found only by such a continuation. family (rows,): the number of the attractor's family, 0 for quiet motion, −1
    for undecided samples. which (n, count): the row of the attractor that each sample reaches.
    changes: the beginnings and ends of families, in order along the path.
    quantities: the accumulated quantities of each sample (n, count), by name.
    """

    parameters: Array
    count: int
    attractors: AttractorTable
    entered: NDArray[np.bool_]
    family: NDArray[np.int64]
    which: NDArray[np.int64]
    changes: tuple[FamilyChange, ...]
    quantities: Mapping[str, Array]

    @property
    def families(self) -> tuple[int, ...]:
        """The numbers of the families, ascending: 0 is quiet motion, 1 is the family that exists at the most steps."""
        return tuple(int(x) for x in np.unique(self.family) if x >= 0)

    def label(self, number: int) -> tuple[str, int, int, int]:
        """Return the label of a family: kind, m, n₊ and n₋."""
        row = self._rows_of_family(number)[0]
        return KINDS[self.attractors.kind[row]], *self.attractors.label(row)

    def fractions(self, number: int) -> Array:
        """Return the basin fraction of a family at each step (n,), NaN where the family does not exist."""
        won = self._sample_counts(number)
        return np.where(won >= 0, won / self.count, np.nan)

    def fraction_intervals(self, number: int) -> tuple[Array, Array]:
        """Return both ends (n,) of the 95 % Wilson interval of a family's fraction; NaN where the family is missing."""
        won = self._sample_counts(number)
        low, high = wilson_interval(np.maximum(won, 0), self.count)
        return np.where(won >= 0, low, np.nan), np.where(won >= 0, high, np.nan)

    def means(self, name: str, number: int) -> tuple[Array, Array]:
        """Return the mean of a quantity over the samples of a family, and the mean's standard error, at each step (n,).

        name: the name of the quantity in `quantities`. number: the number of the family.

        Returns
        -------
        tuple[Array, Array]
            Means and standard errors; NaN at steps where no sample of the family has a known value. A standard error is
            also NaN where only one sample has a known value.
        """
        mine = np.isin(self.which, self._rows_of_family(number))
        values = np.where(mine, self.quantities[name], 0.0)
        known = np.where(mine, ~np.isnan(self.quantities[name]), False)
        values, many = np.where(known, values, 0.0), known.sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            mean = values.sum(axis=1) / many
            spread = np.where(known, (self.quantities[name] - mean[:, None]) ** 2, 0.0).sum(axis=1)
            return mean, np.sqrt(spread / (many - 1) / many)

    def _rows_of_family(self, number: int) -> NDArray[np.int64]:
        """Return the rows of a family in `attractors`. Raises ParameterError if there is no such family."""
        rows = np.flatnonzero(self.family == number)
        require(rows.size > 0, f"there is no family {number}: choose one of {', '.join(map(str, self.families))}")
        return rows

    def _sample_counts(self, number: int) -> NDArray[np.int64]:
        """Return the number of samples that reach a family at each step (n,), −1 where the family does not exist."""
        rows = self._rows_of_family(number)
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
    """Return the attractors along a path of parameters, joined to families.

    Each stable orbit is continued to the neighbouring steps. So a step also has the orbits that its samples missed.
    Chaotic attractors of two steps are one family if they visit the same states (docs/families.md).

    Parameters
    ----------
    path : ArrayLike
        The corners of the path: points (k, 2) of (δ, ε), (k, 3) of (δ, ε, β), or more columns with the parameters that
        a model adds.
    count, v_max, seed
        The samples of each step, as in `Gear.attractors`.
    steps : int | None
        The number of equal steps along the path. None: the corners of the path are the steps.
    beta : float
        The half-backlash, if the path has no column of β.
    causes : bool
        If True, find the cause of each beginning and end of a family, by following its orbit. If False, `changes` is
        empty.
    quantities : Mapping[str, Make]
        Further quantities to accumulate for each sample: by name, a function that returns an `Accumulator`.
    periods : float
        The number of forcing periods over which these quantities are accumulated.
    states : States
        Initial states (τ, v) for every step, instead of drawn samples.
    **added : float | None
        The parameters that a model adds, such as `kappa` of the stiff gear, if the path has no columns of them.

    Returns
    -------
    GlobalContinuation
        The attractors, their basin fractions and the changes between steps.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    points = points_along_path(path, beta, added, steps)
    given = None if states is None else check_and_flatten_states(*states)
    sample = SampleSpec(count if given is None else given[0].size, v_max, seed)
    count = sample.count
    require(
        points.size * count <= 64 * MOST_SAMPLES,
        f"{points.size:,} steps of {count:,} samples exceed the limit of {64 * MOST_SAMPLES:,} samples: use fewer "
        "steps or samples",
    )
    tau, v = sample.draw_states(points) if given is None else (np.tile(x, (points.size, 1)) for x in given[:2])
    model = MODELS[points.model]
    table, row = tabulate_attractors(model.classify_states(points, tau.copy(), v.copy()), missed=True)
    attractors, entered, family = model.join_row_of_cells(points, table)
    which = np.flatnonzero(~entered)[row].reshape(-1, count)
    every = points.repeat(count)
    gathered = {
        name: accumulate_at_parameters(every, tau.ravel(), v.ravel(), make(), periods).reshape(-1, count)
        for name, make in quantities.items()
    }
    found = _ChangeFinder(points, attractors, family).find_changes() if causes else ()
    rows = np.stack(list(points.values_by_name.values()), axis=1)
    return GlobalContinuation(rows, count, attractors, entered, family, which, tuple(found), gathered)


class _ChangeFinder:
    """The search for the beginnings and ends of families along a path, and for their causes.

    row_by_family: for each step a dictionary that maps the number of each family that exists there to the row of the
    family's attractor in the table.
    """

    def __init__(self, points: Parameters, attractors: AttractorTable, family: NDArray[np.int64]) -> None:
        self.points, self.rows, self.family = points, attractors, family
        n = points.size
        self.row_by_family = [{int(family[i]): int(i) for i in reversed(self._rows_at_step(step))} for step in range(n)]

    def _rows_at_step(self, step: int) -> NDArray[np.int64]:
        """Return the rows of the attractors of a step that have a family. Rows of undecided samples have none."""
        return np.flatnonzero((self.rows.cell == step) & (self.family >= 0))

    def find_changes(self) -> list[FamilyChange]:
        """Return all changes, in order along the path."""
        found = [
            (family, step, begins)
            for step in range(self.points.size - 1)
            for begins in (False, True)
            for family in sorted(
                self.row_by_family[step + begins].keys() - self.row_by_family[step + 1 - begins].keys()
            )
        ]
        explained: dict[tuple[int, int, bool], FamilyChange] = {}
        # changes of chaotic families are explained last, because such a change may take its cause from another change
        for chaotic in (False, True):
            for each in found:
                if (self.rows.kind[self._row_with_family(*each)] == Outcome.CHAOTIC) == chaotic:
                    explained[each] = self._explain_change(*each, explained)
        return sorted(explained.values(), key=lambda change: (change.step, change.low, change.family))

    def _row_with_family(self, family: int, step: int, begins: bool) -> int:
        """Return the table row of a family where it exists: at `step` + 1 if it begins, at `step` if it ends."""
        return self.row_by_family[step + begins][family]

    def _explain_change(
        self, family: int, step: int, begins: bool, others: dict[tuple[int, int, bool], FamilyChange]
    ) -> FamilyChange:
        """Return the beginning or the end of a family between `step` and `step` + 1, with its cause.

        begins: True for the beginning of the family, False for its end. others: the changes whose causes are already
        found; the keys are (family, step, begins).

        Returns
        -------
        FamilyChange
            The beginning or end, with its cause and its position along the path.
        """
        row, where, away = self._row_with_family(family, step, begins), step + begins, step + 1 - begins
        kind, gears = self.rows.kind[row], (gear_at_point(self.points, where), gear_at_point(self.points, away))
        end = OrbitEnd(UNKNOWN, 0.0, 1.0)
        if kind == Outcome.QUIET:
            limited = gears[1].epsilon >= gears[1].quiet_limit
            return self._change_from_end(
                family, step, begins, OrbitEnd(QUIET_LIMIT if limited else SAMPLING, 0.0, 1.0), -1
            )
        other = self._find_reached_family(row, away, *gears)
        if kind == Outcome.PERIODIC:
            orbit = TrackedOrbit(self.rows.label(row), float(self.rows.tau[row]), float(self.rows.v[row]))
            end = find_orbit_end(self.points.take([where]), self.points.take([away]), orbit)
            if end.orbit is not None and (goes_on := self._family_of_orbit(end.orbit, away, gears[1])) >= 0:
                end, other = OrbitEnd(CONTINUES, 0.0, 1.0), goes_on
        elif other in self.row_by_family[where]:
            end = OrbitEnd(CRISIS, 0.0, 1.0)
        elif (because := others.get((other, step, not begins))) is not None:
            return FamilyChange(family, step, begins, *because[3:6], other)
        elif other >= 0:
            # `others` has the changes of all families that are not chaotic, so `other` is a chaotic family too
            end = OrbitEnd(CRISIS, 0.0, 1.0)
        elif other == CHAOS_THERE:
            end, other = OrbitEnd(SAMPLING, 0.0, 1.0), -1
        return self._change_from_end(family, step, begins, end, other)

    def _change_from_end(self, family: int, step: int, begins: bool, end: OrbitEnd, other: int) -> FamilyChange:
        """Return the record of a family's beginning or end between `step` and `step` + 1.

        end: cause and position of the change; `end.low` and `end.high` are shares of the way from the step where the
        family exists to the other step. other: the value of the field `other` of the record.

        Returns
        -------
        FamilyChange
            The record, in which `low` and `high` are positions along the path.
        """
        low, high = (step + 1 - end.high, step + 1 - end.low) if begins else (step + end.low, step + end.high)
        return FamilyChange(family, step, begins, end.cause, float(low), float(high), other)

    def _find_reached_family(self, row: int, step: int, gear: AnyGear, gear_there: AnyGear) -> int:
        """Return the family that motions on an attractor go to when the parameters jump to the parameters of a step.

        A periodic attractor is represented by one of its states, a chaotic attractor by CHAOTIC_STATES states. The
        family to which most of these states go is returned.

        row: the row of the attractor. gear: the gear at the attractor's own step. gear_there: the gear at `step`.

        Returns
        -------
        int
            The number of the family. CHAOS_THERE if the motions become chaotic and no chaotic family is known at
            `step`. −1 if the motions go to any other attractor without a family, or if they are not followed, because
            motions could take too many impacts to become quiet.
        """
        tau, v = float(self.rows.tau[row]), float(self.rows.v[row])
        if self.rows.kind[row] == Outcome.CHAOTIC and model_of_gear(gear_there).becomes_quiet_late(
            gear_there.delta, gear_there.epsilon
        ):
            # at `step`, a motion can make so many impacts before it is quiet that it would be labelled chaotic
            return -1
        many = CHAOTIC_STATES if self.rows.kind[row] == Outcome.CHAOTIC else 1
        on = gear.iterate(tau, v, 7 * np.arange(many))
        attractor = gear_there.reached(on.tau, on.v).attractors[0]
        for family, other in self.row_by_family[step].items():
            if self._is_attractor_of_row(attractor, other, speed_unit_of(gear_there)):
                return family
        return CHAOS_THERE if attractor.kind == KINDS[Outcome.CHAOTIC] else -1

    def _family_of_orbit(self, orbit: TrackedOrbit, step: int, gear: AnyGear) -> int:
        """Return the number of the family whose attractor at a step is the orbit `orbit`, −1 if there is none."""
        all_of_it = gear.iterate(orbit.tau, orbit.v, np.arange(orbit.label[1]))
        for family, row in self.row_by_family[step].items():
            if self.rows.label(row) == orbit.label:
                far = abs(wrap_phase_difference(all_of_it.tau - self.rows.tau[row]))
                far = np.maximum(far, abs(all_of_it.v - self.rows.v[row]) / speed_unit_of(gear))
                if far.min() < SAME_POINT:
                    return family
        return -1

    def _is_attractor_of_row(self, attractor: Attractor, row: int, unit: float) -> bool:
        """Return whether `attractor` and the attractor in a row of the table are the same. unit: the unit of speeds."""
        label = KINDS[self.rows.kind[row]], *self.rows.label(row)
        if label != (attractor.kind, attractor.m, attractor.n_plus, attractor.n_minus):
            return False
        far = abs(wrap_phase_difference(attractor.tau - self.rows.tau[row])), abs(attractor.v - self.rows.v[row]) / unit
        return bool(self.rows.kind[row] != Outcome.PERIODIC or max(far) < SAME_POINT)
