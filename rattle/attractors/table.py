"""Tables of the attractors of cells, with the fraction of initial conditions that each attractor wins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rattle.attractors.chaos import pool_exponents
from rattle.attractors.classify import Classifier
from rattle.attractors.rows import attractor_rows
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import MOST_SAMPLES, SampleSpec
from rattle.errors import require
from rattle.notebook import Columns, DataFrame, dataframe_of, html_of, html_table, plain_text_table, repr_text
from rattle.numerics.sampling import wilson_interval
from rattle.numerics.struct_of_arrays import StructOfArrays
from rattle.parameters import Parameters

KINDS = ("none", "quiet", "periodic", "chaotic", "undecided")


@dataclass(frozen=True)
class Attractor:
    """A motion that attracts a fraction of the sampled initial conditions.

    Attributes
    ----------
    kind : str
        "quiet", "periodic", "chaotic" or "undecided" (all undecided samples together).
    m, n_plus, n_minus : int
        The label P(m, n₊, n₋); 0 unless periodic.
    fraction, fraction_interval
        Fraction of the sample, and its 95 % Wilson interval.
    lyapunov : tuple[float, float]
        Both exponents per forcing period, in nats: ln|multiplier|/m if periodic; NaN if quiet or undecided.
    lyapunov_error : float
        95 % half-width of the first exponent; 0 if periodic.
    tau, v : float
        A point of the attractor on Σ⁺; the fastest impact if periodic.
    contacts : int
        Contact phases in m periods of a periodic motion; only a gear with restitution has them. If there are any, n₊
        and n₋ count a run of impacts that ends in contact as one impact, and both exponents are −∞, because contact
        forgets the earlier state.
    """

    kind: str
    m: int
    n_plus: int
    n_minus: int
    fraction: float
    fraction_interval: tuple[float, float]
    lyapunov: tuple[float, float]
    lyapunov_error: float
    tau: float
    v: float
    contacts: int = 0

    @property
    def name(self) -> str:
        """Short name: the label of a periodic motion, "P(1,1,0)" or "P(1,1,0;1)" with one contact, or else the kind."""
        if self.kind != KINDS[Outcome.PERIODIC]:
            return self.kind
        phases = f";{self.contacts}" if self.contacts else ""
        return f"P({self.m},{self.n_plus},{self.n_minus}{phases})"

    def _repr_html_(self) -> str:
        return html_table(self.name, attractor_columns((self,)))


def attractor_columns(attractors: Sequence[Attractor]) -> Columns:
    """Return the columns of a table that shows one attractor in each row."""
    return {
        "kind": [each.kind for each in attractors],
        "m": [each.m for each in attractors],
        "n_plus": [each.n_plus for each in attractors],
        "n_minus": [each.n_minus for each in attractors],
        "fraction": [each.fraction for each in attractors],
        "lyapunov_1": [each.lyapunov[0] for each in attractors],
        "lyapunov_2": [each.lyapunov[1] for each in attractors],
        "tau": [each.tau for each in attractors],
        "v": [each.v for each in attractors],
    }


class AttractorTuple(tuple[Attractor, ...]):
    """A tuple of the attractors of one parameter point, displayed as a table."""

    __slots__ = ()

    def _columns(self) -> Columns:
        return {
            "attractor": [each.name for each in self],
            "fraction": [each.fraction for each in self],
            "95 % from": [each.fraction_interval[0] for each in self],
            "to": [each.fraction_interval[1] for each in self],
            "lyapunov_1": [each.lyapunov[0] for each in self],
            "lyapunov_2": [each.lyapunov[1] for each in self],
            "tau": [each.tau for each in self],
            "v": [each.v for each in self],
        }

    def __repr__(self) -> str:
        """Return a plain-text table with one attractor in each row."""
        return plain_text_table(self._columns())

    def _repr_html_(self) -> str:
        return html_table(f"{len(self)} attractors", self._columns())


@dataclass(frozen=True, repr=False, eq=False)
class AttractorTable(StructOfArrays):
    """The attractors of many cells as arrays (n,), ordered by cell, and in a cell by falling number of samples.

    Fields that are not listed here have the same meaning as those of `Attractor`.

    Attributes
    ----------
    cell : ndarray of int
        Number of the cell.
    kind : ndarray of int
        Index into `KINDS`.
    samples : ndarray of int
        Number of samples that reached the attractor; 0 for a known orbit that no sample reached.
    first, second, error : ndarray
        Both Lyapunov exponents per forcing period, and the 95 % half-width of the first.
    impacts : ndarray of int
        Sum of the impacts on Σ⁺ of the samples that reached the attractor.
    watched : ndarray
        Least number of forcing periods for which the samples of a chaotic attractor, or undecided samples, were
        followed; NaN for other kinds.
    contacts : ndarray of int, optional
        Number of contact phases in m periods; by default 0 for all attractors.
    """

    cell: NDArray[np.int64]
    kind: NDArray[np.int64]
    m: NDArray[np.int64]
    n_plus: NDArray[np.int64]
    n_minus: NDArray[np.int64]
    samples: NDArray[np.int64]
    tau: NDArray[np.float64]
    v: NDArray[np.float64]
    first: NDArray[np.float64]
    second: NDArray[np.float64]
    error: NDArray[np.float64]
    impacts: NDArray[np.int64]
    watched: NDArray[np.float64]
    contacts: Any = None

    def __post_init__(self) -> None:
        """Set `contacts` to 0 for every attractor if it is not given."""
        if self.contacts is None:
            object.__setattr__(self, "contacts", np.zeros(self.kind.size, np.int64))

    @classmethod
    def empty(cls) -> Self:
        """Return a table without rows."""
        columns: dict[str, Any] = dict.fromkeys(("tau", "v", "first", "second", "error", "watched"), np.zeros(0))
        whole = ("cell", "kind", "m", "n_plus", "n_minus", "samples", "impacts")
        columns |= dict.fromkeys(whole, np.zeros(0, np.int64))
        return cls(**columns)

    def label(self, row: int | np.integer) -> tuple[int, int, int]:
        """Return (m, n₊, n₋) of a row; all three are 0 unless the attractor is periodic."""
        return int(self.m[row]), int(self.n_plus[row]), int(self.n_minus[row])

    def _caption(self) -> str:
        return f"{self.cell.size} attractors of {np.unique(self.cell).size} cells"

    def _columns(self) -> Columns:
        return self.columns() | {"kind": np.array(KINDS)[self.kind]}

    def __repr__(self) -> str:
        """Return the numbers of attractors and of cells, such as "<3 attractors of 2 cells>"."""
        return repr_text(self)

    def _repr_html_(self) -> str:
        return html_of(self)

    def to_dataframe(self) -> DataFrame:
        """Return a DataFrame with a row for each attractor. Raises MissingExtraError without pandas."""
        return dataframe_of(self)


#: An older name of `AttractorTable`.
Attractors = AttractorTable


def _kinds_and_orbit_numbers(classifier: Classifier) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the kind of every sample, and the number of its orbit or chaotic attractor in its cell."""
    status = classifier.samples.status
    kind = np.full(status.size, Outcome.UNDECIDED)
    kind[status == Outcome.QUIET], kind[status == Outcome.PERIODIC] = Outcome.QUIET, Outcome.PERIODIC
    which = np.where(status == Outcome.PERIODIC, classifier.samples.orbit, 0)
    chaotic = [(i, each.samples) for chaos in classifier.chaotic_sets.values() for i, each in enumerate(chaos)]
    if chaotic:
        number, samples = zip(*chaotic, strict=True)
        on, of = np.concatenate(samples), np.repeat(number, [each.size for each in samples])
        left = status[on] == Outcome.UNRESOLVED
        kind[on[left]], which[on[left]] = Outcome.CHAOTIC, of[left]
    return kind, which


def tabulate_attractors(classifier: Classifier, missed: bool = False) -> tuple[AttractorTable, NDArray[np.int64]]:
    """Return one row for every attractor of every cell, and the row of every sample.

    With `missed`, known stable orbits that no sample reached have rows too.

    Returns
    -------
    tuple[AttractorTable, NDArray[np.int64]]
        The table, and the row of each sample, cell by cell.
    """
    kind, which = _kinds_and_orbit_numbers(classifier)
    samples, orbits = classifier.samples, classifier.orbits
    row, known = np.empty(kind.size, np.int64), orbits.n if missed else np.zeros_like(orbits.n)
    rows = attractor_rows(kind, which, samples.impacts, samples.time, known, row)
    cell, kind, which, first_sample, number, impacts, watched = rows
    watched[(kind != Outcome.CHAOTIC) & (kind != Outcome.UNDECIDED)] = np.nan
    periodic = kind == Outcome.PERIODIC

    def values_if_periodic(values: NDArray[np.float64], otherwise: ArrayLike) -> NDArray[np.float64]:
        """Return for each row the value of its orbit, from `values` (n_cells, room); `otherwise` if it has no orbit."""
        column = np.minimum(which, values.shape[1] - 1)
        return np.where(periodic, values[cell, column], otherwise)

    first, second = values_if_periodic(orbits.first, np.nan), values_if_periodic(orbits.second, np.nan)
    error = np.where(periodic, 0.0, np.nan)
    chaotic = np.flatnonzero(kind == Outcome.CHAOTIC)
    if chaotic.size:
        found = [
            classifier.chaotic_sets[c][i] for c, i in zip(cell[chaotic].tolist(), which[chaotic].tolist(), strict=True)
        ]
        first[chaotic], second[chaotic], error[chaotic] = pool_exponents([each.sums for each in found])
        watched[chaotic] = [each.observation_time for each in found]
    labels = orbits.m, orbits.n_plus - orbits.merged, orbits.n_minus, orbits.contacts
    m, n_plus, n_minus, contacts = (values_if_periodic(x, 0).astype(np.int64) for x in labels)
    tau = values_if_periodic(orbits.tau, samples.tau[first_sample])
    v = values_if_periodic(orbits.v, samples.v[first_sample])
    order = np.lexsort((tau, v, n_minus, n_plus, m, kind, -number, cell))
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    table = AttractorTable(
        cell=cell,
        kind=kind,
        m=m,
        n_plus=n_plus,
        n_minus=n_minus,
        samples=number,
        tau=tau,
        v=v,
        first=first,
        second=second,
        error=error,
        impacts=impacts,
        watched=watched,
        contacts=contacts,
    )
    return table.take(order), place[row]


def attractors_of_samples(classifier: type[Classifier], parameters: Parameters, sample: SampleSpec) -> AttractorTable:
    """Return the attractors that samples of these parameter points find, and known stable orbits that the samples miss.

    Returns
    -------
    AttractorTable
        A row for each attractor; 0 samples for a missed orbit.

    Raises
    ------
    ParameterError
        If there are too many samples in all, or the largest speed or the sampled box is not valid.
    """
    cells = parameters.flat()
    require(
        cells.size * sample.count <= 64 * MOST_SAMPLES,
        f"{cells.size:,} cells of {sample.count:,} samples exceed the limit of {64 * MOST_SAMPLES:,} samples: give "
        "fewer cells or samples, or make a survey",
    )
    found = classifier.classify(cells, *sample.draw_states(cells), sample.budget)
    table, _rows = tabulate_attractors(found, missed=True)
    return table


def attractors_of_cell(table: AttractorTable, samples: NDArray[np.int64]) -> tuple[Attractor, ...]:
    """Return the attractors in the rows of `table`, which must all belong to one cell.

    samples (rows,): the number of states that go to each attractor. The fractions are computed from these numbers, not
    from the table's column `samples`. For basins a state is the centre of a cell of the basin grid.

    Returns
    -------
    tuple[Attractor, ...]
        The attractors, in the order of the rows.
    """
    count = int(samples.sum())
    low, high = wilson_interval(samples, count)
    return AttractorTuple(
        Attractor(
            kind=KINDS[table.kind[i]],
            m=int(table.m[i]),
            n_plus=int(table.n_plus[i]),
            n_minus=int(table.n_minus[i]),
            fraction=int(samples[i]) / count,
            fraction_interval=(float(low[i]), float(high[i])),
            lyapunov=(float(table.first[i]), float(table.second[i])),
            lyapunov_error=float(table.error[i]),
            tau=float(table.tau[i]),
            v=float(table.v[i]),
            contacts=int(table.contacts[i]),
        )
        for i in range(table.cell.size)
    )
