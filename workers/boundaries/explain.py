"""Explain the boundaries of a survey: find the bifurcation curve between every two neighbouring cells that differ.

The curves of the period-one motions are tried first. If two neighbours differ by a motion that none of these curves
makes or ends, the motion is followed from one cell to the other (`rattle.impacting.bifurcations.branches.continue_to`)
until it meets a saddle-node, flip or graze. If several pairs differ by a motion of the same label, a curve is traced
from that point, which may explain further pairs.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from gear_rattle.workers.boundaries.labels import QUIET_LABEL, Label, labels_at_bifurcation, labels_changed_at_curve
from gear_rattle.workers.boundaries.pairs import (
    KINDS,
    CellAttractor,
    CellGrid,
    DifferingPairs,
    are_pairs_crossed,
    label_text,
)
from gear_rattle.workers.errors import SurveyError
from rattle import (
    REGIONS,
    Event,
    PeriodicOrbit,
    RattleError,
    continue_to,
    curves,
    period_one,
    periodic_orbit,
    quiet_limit,
)
from rattle.curves import Curve
from rattle.models import DEFAULT_MODEL, MODELS, Capability, missing_capability_error

CHAOTIC = KINDS.index("chaotic")
MOST_CURVES = 100  # default of the largest number of computed curves of motions of higher period
LEAST_PAIRS_FOR_CURVE = 4  # a curve is traced if at least this many pairs of cells differ in a label
#: Curves of motions with more impacts per period than this are not traced: they take seconds and explain few pairs.
LONGEST_TRACED = 16
#: Number of points of a traced curve across the survey. Few points suffice, because crossings with grid lines are
#: computed exactly.
CURVE_POINTS_ACROSS = 30
ORBITS = ("A", "B", "C", "D")


@dataclass(frozen=True)
class ExplainingCurve:
    """A bifurcation curve, and the pairs of neighbouring cells that it explains.

    labels: the labels of the attractors that the curve may make or end. bounds_regions: whether the curve divides
    regions. crosses (n,): for each pair, whether the curve passes between its cells. n_explained_pairs: how many of the
    crossed pairs differ by an attractor with one of these labels, or by a region that the curve bounds.
    """

    curve: Curve
    labels: frozenset[Label]
    bounds_regions: bool
    crosses: np.ndarray
    n_explained_pairs: int = 0


@dataclass(frozen=True)
class UnexplainedPairs:
    """The pairs that no curve explains, grouped by what changes between the two cells and by the reason.

    change: the difference between the two cells, in words. why: the reason why no curve explains the difference.
    n_pairs: how many pairs the group has. example: (δ, ε) of both cells of one pair.
    """

    change: str
    why: str
    n_pairs: int
    example: tuple[tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class BoundaryExplanation:
    """The explanation of a survey's boundaries.

    pairs: the n pairs of neighbouring cells that differ. explaining_curves: the curves, sorted by the number of pairs
    that each explains, largest first. region_explained (n,): whether the cells of a pair differ in their region, and a
    curve between them explains it. attractors_explained (n,): the same for their attractors. differ_by_samples_only
    (n,): whether the cells of a pair have the same families, so that they differ only because samples of one cell
    missed an attractor.
    n_pairs_with_followed_bifurcation: the number of pairs without a known curve between their cells, but with a
    bifurcation: a motion that was followed from one cell to the other met this bifurcation. unexplained_groups: the
    unexplained pairs, in groups. crossed (n,): whether a known curve or such a bifurcation lies between the cells of a
    pair.
    """

    pairs: DifferingPairs
    explaining_curves: tuple[ExplainingCurve, ...]
    region_explained: np.ndarray
    attractors_explained: np.ndarray
    differ_by_samples_only: np.ndarray
    n_pairs_with_followed_bifurcation: int
    unexplained_groups: tuple[UnexplainedPairs, ...]
    crossed: np.ndarray


def explain(
    dataset: xr.Dataset, most_curves: int = MOST_CURVES, families: xr.Dataset | None = None
) -> BoundaryExplanation:
    """Explain the boundaries between the cells of an open survey, finished or not.

    Parameters
    ----------
    most_curves : int
        The largest number of curves of motions of higher period that are computed.
    families : xr.Dataset | None
        The group `families` of the survey, if it has one.

    Returns
    -------
    BoundaryExplanation
        Curves by falling number of explained pairs, and the pairs that no curve explains.

    Raises
    ------
    SurveyError
        The survey has neither regions nor attractors, or its model has no curves.
    """
    model = MODELS[dataset.attrs.get("model", DEFAULT_MODEL)]
    if Capability.BOUNDARIES not in model.has:
        raise SurveyError(str(missing_capability_error(Capability.BOUNDARIES, model)))
    search = _CurveSearch(CellGrid(dataset, families), most_curves)
    why = dict(search.run())
    region = search.pairs_with_explained_regions()
    every = range(len(search.pairs))
    sampling = np.array([not search.changes[n] for n in every], bool) & search.pairs.attractors
    attractors = np.array([not search.unexplained_labels(n) for n in every], bool) & search.pairs.attractors & ~sampling
    crossing = np.any([item.crosses for item in search.explaining_curves], axis=0)
    met = np.array(sorted(search.bifurcating_labels), np.int64)
    met = met[~crossing[met]]
    crossing[met] = True
    return BoundaryExplanation(
        search.pairs,
        tuple(sorted(search.curves_with_counts(), key=lambda item: -item.n_explained_pairs)),
        region,
        attractors,
        sampling,
        met.size,
        _group_unexplained_pairs(search, why, region, attractors | sampling),
        crossing,
    )


@dataclass
class _CurveSearch:
    """The search for curves between the differing cells of a survey.

    bifurcating_labels: {number of a pair: labels of motions that bifurcate between its cells}, for motions that were
    followed.
    """

    grid: CellGrid
    most_curves: int
    pairs: DifferingPairs = field(init=False)
    explaining_curves: list[ExplainingCurve] = field(default_factory=list)
    bifurcating_labels: dict[int, frozenset[Label]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.pairs = self.grid.differing_pairs()
        for name in curves.NAMES:
            curve = curves.trace(name, self.grid.beta, *self.window)
            self._add_curve(curve, labels_changed_at_curve(name), name not in ("PDC", "quiet_limit"))
        self.changes = [_changed_labels(self.grid, self.pairs, n) for n in range(len(self.pairs))]
        self.n_pairs_by_label = Counter(label for n in range(len(self.pairs)) for label in self.unexplained_labels(n))

    @property
    def window(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The ranges of δ and ε of the survey."""
        delta, epsilon = self.grid.delta, self.grid.epsilon
        return (float(delta[0]), float(delta[-1])), (float(epsilon[0]), float(epsilon[-1]))

    def run(self) -> Iterator[tuple[int, str]]:
        """Compute curves for all pairs. Yield (pair number, reason) for each difference that no curve explains."""
        for n in range(len(self.pairs)):
            if self.pairs.region[n] and not self.pairs_with_explained_regions()[n]:
                for orbit, target in self._period_one_changes(n):
                    self._follow_motion(n, orbit, target, should_trace=True)
                if not self.pairs_with_explained_regions()[n]:
                    yield n, "the region's boundary could not be followed"
            for label in self.unexplained_labels(n):
                reason = self._explain_label(n, label)
                if reason:
                    yield n, reason

    def curves_with_counts(self) -> Iterator[ExplainingCurve]:
        """Yield the curves, each with the number of pairs that it explains."""
        for item in self.explaining_curves:
            here = np.flatnonzero(item.crosses)
            own = np.array([bool(item.labels.intersection(self.changes[n])) for n in here], bool)
            region = self.pairs.region[here] & item.bounds_regions
            yield replace(item, n_explained_pairs=int(np.sum(own | region)))

    def pairs_with_explained_regions(self) -> np.ndarray:
        """Return for each pair (n,) whether its cells' regions differ and a curve between the cells bounds regions."""
        bounds = [item.crosses for item in self.explaining_curves if item.bounds_regions]
        return self.pairs.region & np.any(bounds, axis=0)

    def unexplained_labels(self, n: int) -> list[Label]:
        """Return the labels of the unexplained differences between the cells of the n-th pair.

        A label is returned if the cells have different numbers of attractors with this label, and no curve between the
        cells makes or ends motions with this label. Chaos is an exception. It counts as explained if the cells also
        differ in other attractors, and curves explain all these differences: chaos then takes the place of a motion
        that a curve ends, or gives way to a motion that a curve makes.

        Returns
        -------
        list[Label]
            Empty if curves explain all differences.
        """
        changed = self.changes[n]
        here = [item.labels for item in self.explaining_curves if item.crosses[n]] + [
            self.bifurcating_labels.get(n, frozenset())
        ]
        left = [label for label in changed if label[0] != CHAOTIC and not any(label in labels for labels in here)]
        chaos = [label for label in changed if label[0] == CHAOTIC]
        return left + chaos if left or len(chaos) == len(changed) else []

    def _explain_label(self, n: int, label: Label) -> str | None:
        """Look for a curve that explains why the cells of the n-th pair differ in a label.

        Returns
        -------
        str | None
            None if such a curve is found. Otherwise the cause of the difference in words, such as "quiet limit", or
            the reason why no curve is found.
        """
        if label == QUIET_LABEL:
            return (
                "quiet motion exists on both sides: its basin fraction is small"
                if self._has_quiet_motion(n)
                else "quiet limit"
            )
        if label[0] == CHAOTIC:
            return "chaos begins or ends by itself: a crisis, or a transient longer than the observation time"
        here, there, attractor = self._ordered_pair_with_attractor(n, label)
        try:
            start = periodic_orbit(*self.grid.point(here), attractor.tau, attractor.v, label[2], self.grid.beta)
        except RattleError:
            return "the motion could not be solved for"
        found = self._follow_motion(
            n, start, self.grid.point(there), self.n_pairs_by_label[label] >= LEAST_PAIRS_FOR_CURVE
        )
        if isinstance(found, PeriodicOrbit):
            return "the motion attracts on both sides: its basin fraction is small, and samples missed it"
        if found is None:
            return "the motion could not be followed"
        return None if label not in self.unexplained_labels(n) else f"{found.kind} of another motion on the way"

    def _ordered_pair_with_attractor(self, n: int, label: Label) -> tuple[np.ndarray, np.ndarray, CellAttractor]:
        """Return both cells of the n-th pair, and an attractor with the label.

        Returns
        -------
        tuple[np.ndarray, np.ndarray, CellAttractor]
            The cell with more attractors of this label; the other cell; and the attractor of this label in the first
            cell with the least basin fraction.
        """
        ends = self.pairs.first[n], self.pairs.second[n]
        having = [[found for found in self.grid.attractors(cell) if found.label == label] for cell in ends]
        here = 0 if len(having[0]) > len(having[1]) else 1
        return ends[here], ends[1 - here], having[here][-1]

    def _has_quiet_motion(self, n: int) -> bool:
        """Return whether quiet motion exists in both cells of the n-th pair."""
        return all(
            epsilon < quiet_limit(delta)
            for delta, epsilon in map(self.grid.point, (self.pairs.first[n], self.pairs.second[n]))
        )

    def _period_one_changes(self, n: int) -> Iterator[tuple[PeriodicOrbit, tuple[float, float]]]:
        """Yield the orbits A to D whose existence or stability differs between the cells of the n-th pair.

        Yields
        ------
        tuple[PeriodicOrbit, tuple[float, float]]
            An orbit as it is in one of the cells, and (δ, ε) of the other cell.
        """
        points = [self.grid.point(cell) for cell in (self.pairs.first[n], self.pairs.second[n])]
        found = [period_one(*point, self.grid.beta) for point in points]
        for here, there in ((0, 1), (1, 0)):
            for i in range(len(ORBITS)):
                same = (
                    found[here].exists[i] == found[there].exists[i] and found[here].stable[i] == found[there].stable[i]
                )
                if found[here].exists[i] and not same:
                    tau, v = float(found[here].tau[i]), float(found[here].v[i])
                    yield periodic_orbit(*points[here], tau, v, 1, self.grid.beta), points[there]

    def _follow_motion(
        self, n: int, orbit: PeriodicOrbit, target: tuple[float, float], should_trace: bool
    ) -> PeriodicOrbit | Event | None:
        """Follow a motion from its cell to the other cell of the pair, at (δ, ε) = target, or to a bifurcation.

        should_trace: whether to trace the bifurcation's curve through the survey as well. It is never traced if the
        motion has more than LONGEST_TRACED impacts per period, or if `most_curves` curves were traced already.

        Returns
        -------
        PeriodicOrbit | Event | None
            The motion at the target, or the bifurcation that it meets; None if the motion could not be followed.
        """
        found = continue_to(orbit, *target)
        if isinstance(found, Event):
            self.bifurcating_labels[n] = self.bifurcating_labels.get(n, frozenset()) | _labels_at_event(found)
            should_trace = should_trace and found.itinerary.n <= LONGEST_TRACED
            if should_trace and len(self.explaining_curves) < len(curves.NAMES) + self.most_curves:
                curve = curves.bifurcation_curve(found, *self.window, CURVE_POINTS_ACROSS)
                self._add_curve(curve, _labels_at_event(found), found.itinerary.m == 1)
        return found

    def _add_curve(self, curve: Curve, labels: frozenset[Label], bounds_regions: bool) -> None:
        self.explaining_curves.append(
            ExplainingCurve(curve, labels, bounds_regions, are_pairs_crossed(curve, self.grid, self.pairs))
        )


def _labels_at_event(event: Event) -> frozenset[Label]:
    return labels_at_bifurcation(event.itinerary.walls, event.itinerary.m, event.impact, event.kind == "PD")


def _changed_labels(grid: CellGrid, pairs: DifferingPairs, n: int) -> list[Label]:
    """Return the labels of which the two cells of the n-th pair have different numbers of attractors.

    If the survey has families, a label whose families are the same in both cells is left out.

    Returns
    -------
    list[Label]
        Labels in ascending order; empty if the attractors of the cells do not differ.
    """
    if not pairs.attractors[n]:
        return []
    cells = pairs.first[n], pairs.second[n]
    one, other = (Counter(found.label for found in grid.attractors(cell)) for cell in cells)
    told = grid.differing_labels(*cells)
    changed = {*(one - other), *(other - one)}
    return sorted(changed if told is None else changed & told)


def _group_unexplained_pairs(
    search: _CurveSearch, why: dict[int, str], region: np.ndarray, attractors: np.ndarray
) -> tuple[UnexplainedPairs, ...]:
    """Return the unexplained pairs, grouped by change and reason, largest group first.

    why: {number of a pair: reason why no curve explains its difference}. region, attractors (n,): whether a difference
    of the pair's regions, and of its attractors, is explained.

    Returns
    -------
    tuple[UnexplainedPairs, ...]
        The groups.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    pairs, grid = search.pairs, search.grid
    for n in map(int, np.flatnonzero((pairs.region & ~region) | (pairs.attractors & ~attractors))):
        if pairs.region[n] and not region[n]:
            change = "region " + " | ".join(REGIONS[grid.region[i, j]] for i, j in (pairs.first[n], pairs.second[n]))
        else:
            change = " and ".join(label_text(label) for label in search.unexplained_labels(n))
        groups.setdefault((change, why.get(n, "")), []).append(n)
    found = [
        UnexplainedPairs(
            change, reason, len(members), (grid.point(pairs.first[members[0]]), grid.point(pairs.second[members[0]]))
        )
        for (change, reason), members in groups.items()
    ]
    return tuple(sorted(found, key=lambda rest: (-rest.n_pairs, rest.change)))
