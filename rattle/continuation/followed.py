"""The base class of the branches of all gears: their fields, display, and conversion to pandas and xarray."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.flight.law import fold_phase
from rattle.notebook import (
    Columns,
    DataFrame,
    Dataset,
    Figure,
    dataframe_of,
    dataset_of,
    figure_of,
    html_of,
    motion_label,
    repr_text,
)
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic_motions import Equations


@dataclass(frozen=True, repr=False)
class FollowedBranch(ABC):
    """A branch: k motions with one itinerary along a line of parameters, each with n impacts or contacts.

    itinerary: the walls and the forcing periods of the motions.
    unknowns (k, N): the unknowns of each motion, then its parameters: δ, ε and others.
    speeds (k, n): the speeds with which each motion leaves the walls.
    multipliers (2, k): the Floquet multipliers.
    stable, admissible (k,): whether the motion attracts, and whether it is admissible (False: virtual).
    start: the index of the point from which the branch was followed in both directions.
    events: the events, in the order of the branch.
    ends: the reasons in words why the branch ends at its first and at its last point.
    """

    itinerary: Any
    unknowns: Array
    speeds: Array
    multipliers: NDArray[np.complex128]
    stable: NDArray[np.bool_]
    admissible: NDArray[np.bool_]
    start: int
    events: tuple[Any, ...]
    ends: tuple[str, str]

    def __len__(self) -> int:
        """Return the number of points of the branch."""
        return len(self.unknowns)

    @property
    @abstractmethod
    def departures(self) -> Array:
        """The times (k, n) at which the motions leave the walls, in forcing periods."""

    @property
    @abstractmethod
    def added(self) -> dict[str, Array]:
        """The parameters (k,) of the model besides δ, ε and β, by name."""

    @property
    def walls(self) -> tuple[int, ...]:
        """The walls that the motions meet, in order."""
        return self.itinerary.walls

    @property
    def m(self) -> int:
        """The number m of forcing periods after which the motions repeat."""
        return self.itinerary.m

    @property
    def beta(self) -> float:
        """The half-backlash β of the motions."""
        return self.itinerary.beta

    @property
    def label(self) -> tuple[int, int, int]:
        """The label (m, n_plus, n_minus) of the motions."""
        return self.itinerary.label

    @property
    def parameters(self) -> Array:
        """The parameters (k, 2 or more) that may change along branches of the model, δ and ε first."""
        return self.unknowns[:, self.itinerary.n :]

    @property
    def delta(self) -> Array:
        """The damping δ (k,)."""
        return self.parameters[:, 0]

    @property
    def epsilon(self) -> Array:
        """The eccentricity ε (k,)."""
        return self.parameters[:, 1]

    @property
    def tau(self) -> Array:
        """The phases (k,) in [0, 1) at which the motions first leave Σ⁺."""
        return np.array([float(fold_phase(time)) for time in self.departures[:, 0]])

    @property
    def v(self) -> Array:
        """The speeds (k,) with which the motions first leave Σ⁺."""
        return self.speeds[:, 0]

    def motion(self, index: int) -> tuple[Any, Array]:
        """Return the itinerary and row `index` of `unknowns` (N,): a motion's unknowns, then its parameters."""
        return self.itinerary, self.unknowns[index]

    def _caption(self) -> str:
        events = ", ".join(f"{each.kind}{'' if each.admissible else ' (virtual)'}" for each in self.events) or "none"
        return (
            f"branch of {motion_label(*self.label)}, {len(self)} points; events: {events}; ends: {', '.join(self.ends)}"
        )

    def _columns(self) -> Columns:
        return {
            "delta": self.delta,
            "epsilon": self.epsilon,
            **self.added,
            "tau": self.tau,
            "v": self.v,
            "multiplier_1": self.multipliers[0],
            "multiplier_2": self.multipliers[1],
            "stable": self.stable,
            "admissible": self.admissible,
        }

    def __repr__(self) -> str:
        """Return a description of the branch in one line."""
        return repr_text(self)

    def _repr_html_(self) -> str:
        return html_of(self)

    def plot(self) -> Figure:
        """Draw speed and phase of the impacts on Σ⁺ against the parameter, with stable parts solid and events marked.

        Returns
        -------
        Figure
            A matplotlib figure.

        Raises
        ------
        MissingExtraError
            If matplotlib is not installed.
        """
        return figure_of(self, "branch_figure")

    def to_dataframe(self) -> DataFrame:
        """Return a table with a row for each point. Raises MissingExtraError if pandas is not installed."""
        return dataframe_of(self)

    def to_xarray(self) -> Dataset:
        """Return the branch as a data set with the dimensions `point`, `number` (of the multiplier) and `impact`.

        Returns
        -------
        Dataset
            Parameters, multipliers, and the times and speeds with which the motions leave the walls.

        Raises
        ------
        MissingExtraError
            If xarray is not installed.
        """
        each = {name: ("point", values) for name, values in self._columns().items() if "multiplier" not in name}
        return dataset_of(
            {
                **{name: each[name] for name in ("tau", "v", "stable", "admissible")},
                "multiplier": (("number", "point"), self.multipliers),
                "departure": (
                    ("point", "impact"),
                    self.departures,
                    {"long_name": "time in forcing periods"},
                ),
                "speed": (("point", "impact"), self.speeds),
            },
            {
                **{name: each[name] for name in ("delta", "epsilon", *self.added)},
                "number": [1, 2],
                "wall": ("impact", np.array(self.itinerary.walls)),
                "beta": self.itinerary.beta,
            },
            {"motion": motion_label(*self.label), "ends": list(self.ends)},
        )


def start_of_doubled_branch(itinerary: Equations, x: Array) -> tuple[Array, Array]:
    """Return the first point of the branch of doubled period that starts at a flip, and the unit tangent there.

    x: the n unknowns of the orbit of the flip, then δ and ε. The first point is this orbit run through twice.

    Returns
    -------
    tuple[Array, Array]
        The point (2n + 1,), which holds the unknowns (2n,) of the doubled orbit and then 0, the offset of the parameter
        from the flip; and the unit tangent (2n + 1,).
    """
    n, impacts = itinerary.n, len(itinerary.walls)
    each = x[:n].reshape(-1, impacts)
    later = each.copy()
    later[0] += itinerary.m
    mode = np.linalg.svd(itinerary.jacobian(x[: n + 2], -1.0))[2][-1].reshape(-1, impacts)
    return np.append(np.hstack([each, later]), 0.0), np.append(np.hstack([mode, -mode]), 0.0) / np.sqrt(2.0)
