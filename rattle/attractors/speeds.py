"""The sampled states of each cell (`SampleSpec`), and the largest sampled speed."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rattle.attractors.classify import BUDGET
from rattle.errors import ParameterError, require_integer, require_number
from rattle.flight.law import natural_speed
from rattle.numerics.sampling import initial_conditions
from rattle.numerics.states import parse_state_box
from rattle.parameters import Parameters

NATURAL: Literal["natural"] = "natural"
SpeedLimit = float | str | None

PAPER_SPEED = 7.0  # largest speed in the paper's figures
#: Ranges of δ, ε and β around the paper's plane. In these ranges the default largest initial speed is `PAPER_SPEED`.
PLANE = ((0.3, 1.5), (0.0, 0.5), (0.2, 1.2))

WHOLE_BOX = (0.0, 1.0, 0.0)  # lowest and highest phase, and lowest speed, of a box of all phases and speeds
MOST_SAMPLES = 1 << 20
LARGEST_BUDGET = 1_000_000_000
LARGEST_SEED = (1 << 128) - 1

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SampleSpec:
    """The initial conditions of each cell, and the budget of impacts of each initial condition.

    Parameters
    ----------
    count : int
        Number of initial conditions of a cell.
    v_max : float or "natural", optional
        The largest speed: see `highest_sampled_speeds`.
    seed : int
        Seed of the sample.
    budget : int
        Impacts on Σ⁺ after which a sample that reached no attractor is undecided.
    tau : tuple of float
        The lowest and the highest phase of the sampled box.
    v_min : float
        The lowest speed of the sampled box.

    Raises
    ------
    ParameterError
        If `count`, `seed` or `budget` is outside its domain. The other values are checked when states are drawn.
    """

    count: int = 256
    v_max: "SpeedLimit" = None
    seed: int = 0
    budget: int = BUDGET
    tau: tuple[float, float] = (0.0, 1.0)
    v_min: float = 0.0

    def __post_init__(self) -> None:
        """Check and convert the fields."""
        for name, low, high in (("budget", 1, LARGEST_BUDGET), ("count", 1, MOST_SAMPLES), ("seed", 0, LARGEST_SEED)):
            object.__setattr__(self, name, require_integer(name, getattr(self, name), low, high))

    def highest_speeds(self, parameters: Parameters) -> Array:
        """Return the largest sampled speed of each cell (n,): see `highest_sampled_speeds`. Raises ParameterError."""
        return highest_sampled_speeds(self.v_max, parameters.delta, parameters.epsilon, parameters.beta)

    def draw_states(self, parameters: Parameters) -> tuple[Array, Array]:
        """Return phases and speeds (n, count) of the initial conditions of cells (n,). Raises ParameterError."""
        highest = self.highest_speeds(parameters)
        if (*self.tau, self.v_min) != WHOLE_BOX and parameters.size:
            parse_state_box(self.tau, (self.v_min, float(highest.min())))
        cells = parameters.delta, parameters.epsilon, parameters.beta
        return initial_conditions(*cells, self.count, highest, self.seed, self.tau, self.v_min)


def are_in_paper_plane(delta: Array, epsilon: Array, beta: Array) -> NDArray[np.bool_]:
    """Return flags: True for parameters in or near the paper's plane, where speeds up to 7 cover all motions."""
    inside = [(low <= x) & (x <= high) for x, (low, high) in zip((delta, epsilon, beta), PLANE, strict=True)]
    return np.asarray(inside[0] & inside[1] & inside[2], np.bool_)


def highest_sampled_speeds(v_max: SpeedLimit, delta: Array, epsilon: Array, beta: Array) -> Array:
    """Return the largest sampled speed of each of these cells (n,).

    `v_max` is a number for all cells; or "natural", which means 1.5 √(16πδβ) + 2πε of each cell; or None, which means 7
    in the paper's plane and the natural speed elsewhere.

    Returns
    -------
    Array
        (n,), dimensionless.

    Raises
    ------
    ParameterError
        If an argument is outside its domain.
    """
    if v_max is None:
        inside = are_in_paper_plane(delta, epsilon, beta)
        return np.asarray(np.where(inside, PAPER_SPEED, natural_speed(delta, epsilon, beta)), np.float64)
    if isinstance(v_max, str):
        if v_max != NATURAL:
            raise ParameterError(f'v_max must be a number above 0 or "{NATURAL}", got {v_max!r}')
        return np.asarray(natural_speed(delta, epsilon, beta), np.float64)
    return np.full(np.shape(delta), require_number("v_max", v_max, positive=True))


def parse_speed_limit(text: str | None) -> SpeedLimit:
    """Return a speed limit given as text: a number, or None if the text is empty.

    Other text is returned as it is; `highest_sampled_speeds` checks it.

    Returns
    -------
    float, str or None
        The speed limit.
    """
    text = (text or "").strip()
    try:
        return float(text) if text else None
    except ValueError:
        return text


def highest_sampled_speed(v_max: SpeedLimit, delta: float, epsilon: float, beta: float) -> float:
    """Return the largest speed that is sampled for one gear; see `highest_sampled_speeds`."""
    return float(highest_sampled_speeds(v_max, *(np.array([x]) for x in (delta, epsilon, beta)))[0])
