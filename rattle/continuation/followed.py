"""Describe a branch of either gear in words, and convert it to pandas and xarray."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rattle.flight.law import folded
from rattle.notebook import (
    Columns,
    DataFrame,
    Dataset,
    Figure,
    dataframe_of,
    dataset_of,
    figure_of,
    html_of,
    line_of,
    motion_label,
)
from rattle.numerics.complex_step import Array
from rattle.orbits.periodic import Equations


@dataclass(frozen=True, repr=False)
class FollowedBranch(ABC):
    """A branch of motions of one itinerary along a line of parameters, k points in order, n impacts or contacts each.

    unknowns (k, N): of each motion, its parameters last, δ and ε first among these. speeds (k, n): with which it leaves
    the walls. multipliers (2, k). stable, admissible (k,): whether the motion attracts, and whether it happens at all
    (False: virtual). start: the point it was followed from. events: in the order of the branch. ends: why it was not
    followed farther, at its first and its last point.
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
        """Return the number of points."""
        return len(self.unknowns)

    @property
    @abstractmethod
    def departures(self) -> Array:
        """Return the times at which the motions leave the walls (k, n), in forcing periods."""

    @property
    @abstractmethod
    def added(self) -> dict[str, Array]:
        """The other parameters (k,) of the model, by name."""

    @property
    def walls(self) -> tuple[int, ...]:
        """The walls of its motions."""
        return self.itinerary.walls

    @property
    def m(self) -> int:
        """Return the forcing periods of the branch's motions."""
        return self.itinerary.m

    @property
    def beta(self) -> float:
        """Return the half-backlash of the branch's motions."""
        return self.itinerary.beta

    @property
    def label(self) -> tuple[int, int, int]:
        """(m, n_plus, n_minus)."""
        return self.itinerary.label

    @property
    def parameters(self) -> Array:
        """The parameters (k, 2) or more that change along branches of the model, δ and ε first."""
        return self.unknowns[:, self.itinerary.n :]

    @property
    def delta(self) -> Array:
        """Damping (k,)."""
        return self.parameters[:, 0]

    @property
    def epsilon(self) -> Array:
        """Eccentricity (k,)."""
        return self.parameters[:, 1]

    @property
    def tau(self) -> Array:
        """Phases (k,) in [0, 1) with which the motions first leave Σ⁺."""
        return np.array([float(folded(time)) for time in self.departures[:, 0]])

    @property
    def v(self) -> Array:
        """Speeds (k,) with which they do."""
        return self.speeds[:, 0]

    def motion(self, index: int) -> tuple[Any, Array]:
        """Itinerary and unknowns (N,) of one point."""
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
        """Return a one-line description."""
        return line_of(self)

    def _repr_html_(self) -> str:
        return html_of(self)

    def plot(self) -> Figure:
        """Draw speed and phase of its impacts on Σ⁺ against the parameter: stable parts solid, events marked.

        Returns
        -------
        Figure
            A matplotlib figure.

        Raises
        ------
        MissingExtraError
            Without matplotlib.
        """
        return figure_of(self, "branch_figure")

    def to_dataframe(self) -> DataFrame:
        """Return a row for each point. Raises MissingExtraError without pandas."""
        return dataframe_of(self)

    def to_xarray(self) -> Dataset:
        """Return the branch along the dimensions point, multiplier and impact.

        Parameters, multipliers, and the times and speeds with which the motions leave the walls. Raises
        MissingExtraError without xarray.

        Returns
        -------
        Dataset
            The data set.
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


def first_of_doubled(itinerary: Equations, x: Array) -> tuple[Array, Array]:
    """Return the flip x (N,) twice over, as y = (unknowns (2n,), 0), and the unit tangent of the doubled branch."""
    n, impacts = itinerary.n, len(itinerary.walls)
    each = x[:n].reshape(-1, impacts)
    later = each.copy()
    later[0] += itinerary.m
    mode = np.linalg.svd(itinerary.jacobian(x[: n + 2], -1.0))[2][-1].reshape(-1, impacts)
    return np.append(np.hstack([each, later]), 0.0), np.append(np.hstack([mode, -mode]), 0.0) / np.sqrt(2.0)
