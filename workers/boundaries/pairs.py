"""Find the pairs of neighbouring cells of a survey that differ, and the pairs between whose cells a curve passes."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from gear_rattle.workers.boundaries.labels import QUIET_LABEL, Label
from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.survey.slices import surveyed_model
from gear_rattle.workers.survey.values.evaluate import FAILED, KINDS
from gear_rattle.workers.survey.values.schema import Group
from rattle import quiet_limit
from rattle.curves import Curve

UNDECIDED = KINDS.index("undecided")


@dataclass(frozen=True)
class DifferingPairs:
    """The pairs of neighbouring cells that differ.

    first, second (n, 2): the indices (i, j) along ε and δ of both cells of each pair; the second cell follows the first
    along δ or along ε. region, attractors (n,): whether the two cells differ in their region, and in their attractors.
    """

    first: np.ndarray
    second: np.ndarray
    region: np.ndarray
    attractors: np.ndarray

    def __len__(self) -> int:
        """Return the number of pairs."""
        return len(self.first)


class CellAttractor(NamedTuple):
    """An attractor of a cell: its label, a state (tau, v) on it, and its basin fraction."""

    label: Label
    tau: float
    v: float
    fraction: float


class CellGrid:
    """The cells of an open survey: the axes δ and ε, the half-backlash, and each cell's region and attractors."""

    def __init__(self, dataset: xr.Dataset, families: xr.Dataset | None = None) -> None:
        """Read the variables that are compared. families: the survey's group `families`; None if it has none.

        Raises
        ------
        SurveyError
            The survey has neither regions nor attractors.
        """
        self.delta, self.epsilon = (np.asarray(dataset[axis]) for axis in ("delta", "epsilon"))
        self.beta = surveyed_model(dataset).beta
        status = np.asarray(dataset["status"])
        self.known = (status > 0) & (status != FAILED)
        self.region = np.asarray(dataset["region"]) if "region" in dataset else np.zeros(status.shape, np.int8)
        names = ("attractor_kind", "attractor_m", "attractor_n_plus", "attractor_n_minus")
        self.labels: np.ndarray | None = None
        self.slots, self.states = tuple[np.ndarray, ...](), tuple[np.ndarray, ...]()
        if all(name in dataset for name in names):
            # Each slot's label becomes one number, so two cells have the same attractors if their sorted numbers agree.
            kind, m, plus, minus = (np.asarray(dataset[name]).astype(np.int64) for name in names)
            self.labels = np.sort(((kind * 2**15 + m) * 2**15 + plus) * 2**15 + minus, axis=0)
            self.slots = kind, m, plus, minus
            self.states = tuple(np.asarray(dataset[f"attractor_{name}"]) for name in ("phase", "velocity", "fraction"))
        self.families = None if families is None else _CellFamilies(dataset, families)
        if "region" not in dataset and self.labels is None:
            raise SurveyError(
                f"the survey has no regions and no attractors: compute a survey with --quantity {Group.REGION} or "
                f"{Group.ATTRACTORS}"
            )

    def differing_pairs(self) -> DifferingPairs:
        """Return the pairs of computed neighbours that differ in their region or in their attractors.

        Attractors are compared only if neither cell has undecided samples, because these may hide an attractor.

        Returns
        -------
        DifferingPairs
            The pairs, first those of neighbours along δ.
        """
        found = []
        for step in ((0, 1), (1, 0)):
            here = tuple(slice(0, size - s) for size, s in zip(self.known.shape, step, strict=True))
            there = tuple(slice(s, None) for s in step)
            known = self.known[here] & self.known[there]
            region = self.region[here] != self.region[there]
            sets = np.zeros(known.shape, bool)
            if self.labels is not None:
                sets = (self.labels[:, *here] != self.labels[:, *there]).any(axis=0)
                sets &= ~(self._cells_with_undecided_sample()[here] | self._cells_with_undecided_sample()[there])
            i, j = np.nonzero(known & (region | sets))
            found.append((np.column_stack([i, j]), np.array(step), region[i, j], sets[i, j]))
        first = np.concatenate([at for at, *_ in found])
        second = np.concatenate([at + step for at, step, *_ in found])
        return DifferingPairs(first, second, *(np.concatenate([item[k] for item in found]) for k in (2, 3)))

    def _cells_with_undecided_sample(self) -> np.ndarray:
        """Return for each cell (m, n) whether it has an undecided sample, so that its attractors are not all known."""
        return (self.slots[0] == UNDECIDED).any(axis=0)

    def differing_labels(self, one: np.ndarray, other: np.ndarray) -> frozenset[Label] | None:
        """Return the labels of the families that exist in only one of two cells, whether samples reached them or not.

        Returns
        -------
        frozenset[Label] | None
            Empty if both cells have the same families; None if the survey has no families.
        """
        if self.families is None:
            return None
        both = [self.families.families_of_cell(cell, self._has_quiet_motion(cell)) for cell in (one, other)]
        return frozenset(self.families.labels[number] for number in both[0] ^ both[1])

    def _has_quiet_motion(self, cell: np.ndarray) -> bool:
        delta, epsilon = self.point(cell)
        return bool(epsilon < quiet_limit(delta))

    def attractors(self, cell: np.ndarray) -> list[CellAttractor]:
        """Return the attractors of one cell (i, j), the largest basin fraction first."""
        columns = (*self.slots, *self.states)
        rows = zip(*(values[:, cell[0], cell[1]] for values in columns), strict=True)
        found = [
            CellAttractor((int(kind), int(m), int(plus), int(minus)), float(tau), float(v), float(share))
            for kind, m, plus, minus, tau, v, share in rows
            if kind
        ]
        return sorted(found, key=lambda each: -each.fraction)

    def point(self, cell: np.ndarray) -> tuple[float, float]:
        """Return (δ, ε) of a cell (i, j)."""
        return float(self.delta[cell[1]]), float(self.epsilon[cell[0]])


class _CellFamilies:
    """The families of each cell.

    A cell has a family if one of the cell's slots lists it, or if the family's orbit was continued into the cell from a
    neighbour. A cell has quiet running if ε is below the quiet limit.
    """

    def __init__(self, dataset: xr.Dataset, families: xr.Dataset) -> None:
        self.slots = np.asarray(dataset["attractor_family"])
        columns = (np.asarray(families[name]).tolist() for name in ("kind", "m", "n_plus", "n_minus"))
        self.labels: list[Label] = list(zip(*columns, strict=True))
        self.labels[0] = QUIET_LABEL
        names = ("entered_row", "entered_column", "entered_family")
        self.entered: dict[tuple[int, int], set[int]] = {}
        for i, j, number in zip(*(np.asarray(families[name]).tolist() for name in names), strict=True):
            self.entered.setdefault((i, j), set()).add(number)

    def families_of_cell(self, cell: np.ndarray, is_quiet: bool) -> set[int]:
        """Return the numbers of the families of a cell (i, j); is_quiet: whether ε is below the quiet limit there."""
        i, j = int(cell[0]), int(cell[1])
        listed = {int(number) for number in self.slots[:, i, j] if number >= 0}
        return listed | self.entered.get((i, j), set()) | ({0} if is_quiet else set())


def are_pairs_crossed(curve: Curve, grid: CellGrid, pairs: DifferingPairs) -> np.ndarray:
    """Return for each pair (n,) whether a curve passes between its cells, from exact crossings with the grid lines."""
    found = np.zeros(len(pairs), bool)
    beside = pairs.first[:, 0] == pairs.second[:, 0]
    for chosen, fixed in ((~beside, "delta"), (beside, "epsilon")):
        column = 1 if fixed == "delta" else 0
        lines, values = (grid.delta, grid.epsilon) if fixed == "delta" else (grid.epsilon, grid.delta)
        for line in np.unique(pairs.first[chosen, column]):
            at = curve.at(**{fixed: float(lines[line])})
            if at:
                mine = np.flatnonzero(chosen & (pairs.first[:, column] == line))
                low, high = values[pairs.first[mine, 1 - column]], values[pairs.second[mine, 1 - column]]
                found[mine] |= np.any([(low <= x) & (x <= high) for x in at], axis=0)
    return found


def label_text(label: Label) -> str:
    """Return a label as text, for example "P(1,1,0)" or "chaotic"."""
    kind, m, n_plus, n_minus = label
    return f"P({m},{n_plus},{n_minus})" if KINDS[kind] == "periodic" else KINDS[kind]
