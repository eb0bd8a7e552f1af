"""Label the axes of a machine's map with speed (rising to the right) and eccentricity (upwards), beside δ and ε."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from gear_rattle.workers.survey.machine import AXES

MICROMETRES = 1e6  # micrometres per metre
LABELS = ("speed, rpm", "eccentricity, µm")
STEPS = 6  # an axis has about this many steps between ticks
NEAREST = 0.1  # least distance between two ticks, as a share of the axis


def draw_machine_axes(axes: Axes, dataset: xr.Dataset) -> bool:
    """Give a map of a machine's survey its speeds and eccentricities as axes; other maps stay as they are.

    Damping falls as speed rises, so δ runs to the left, above the map; ε is on the right.

    Returns
    -------
    bool
        True for a machine's survey.
    """
    if not set(AXES) <= set(dataset.coords):
        return False
    rpm_at_unit_damping = float(dataset["rpm"][0] * dataset["delta"][0])
    per_epsilon = MICROMETRES * float(dataset["eccentricity"][-1] / dataset["epsilon"][-1])
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    axes.set_xlim(right, left)
    slowest, fastest = rpm_at_unit_damping / right, rpm_at_unit_damping / max(left, 1e-3 * right)
    speeds = [each for each in tick_values(slowest, fastest) if slowest <= each <= fastest]
    speeds = _choose_ticks(speeds, np.array([(right - rpm_at_unit_damping / each) / (right - left) for each in speeds]))
    sizes = tick_values(per_epsilon * bottom, per_epsilon * top)
    axes.set_xticks([rpm_at_unit_damping / each for each in speeds], [f"{each:.7g}" for each in speeds])
    axes.set_yticks([each / per_epsilon for each in sizes], [f"{each:.7g}" for each in sizes])
    axes.set(xlabel=LABELS[0], ylabel=LABELS[1])
    axes.minorticks_off()
    axes.secondary_xaxis("top").set_xlabel("damping δ")
    axes.secondary_yaxis("right").set_ylabel("eccentricity ε")
    return True


def tick_values(low: float, high: float) -> list[float]:
    """Return about STEPS round numbers from low to high; over a wide range, 1, 2 and 5 times the powers of ten."""
    if low > 0 and high > 10 * low:
        powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        found = [float(f"{digit}e{power}") for power in powers for digit in (1, 2, 5)]
    else:
        rough = (high - low) / STEPS
        power = 10.0 ** np.floor(np.log10(rough))
        step = next(each * power for each in (1, 2, 5, 10) if each * power >= rough * (1 - 1e-9))
        found = [float(f"{k * step:.12g}") for k in range(int(np.ceil(low / step)), int(high / step) + 1)]
    return [each for each in found if low <= each <= high]


def _choose_ticks(values: list[float], positions: np.ndarray) -> list[float]:
    """Choose the values that get tick labels, so that their positions on the axis are at least NEAREST apart.

    positions: the ascending positions of all values, from 0 to 1.

    Returns
    -------
    list[float]
        The chosen values.
    """
    kept: list[float] = []
    last = -np.inf
    for value, position in zip(values, positions, strict=True):
        if position - last >= NEAREST:
            kept.append(value)
            last = position
    return kept
