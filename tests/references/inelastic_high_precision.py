"""Forcing, contact force, flights and first impacts of the inelastic gear in 40 digits, by code of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from mpmath import mp, mpf

mp.dps = 40
Harmonic = tuple[int, float, float]


class Gear(NamedTuple):
    """Parameters as doubles, of which the 40 digits are exact; harmonics with the first one, amplitudes over ε."""

    delta: float
    epsilon: float
    beta: float
    drift: float
    harmonics: Sequence[Harmonic]


def derivatives(gear: Gear, t: mpf) -> tuple[mpf, mpf, mpf]:
    """Return e, e' and e''."""
    found = [mpf(0)] * 3
    for order, size, phase in gear.harmonics:
        turn = 2 * mp.pi * order
        angle = turn * t + 2 * mp.pi * mpf(phase)
        amplitude = mpf(gear.epsilon) * mpf(size)
        found[0] += amplitude * mp.cos(angle)
        found[1] -= amplitude * turn * mp.sin(angle)
        found[2] -= amplitude * turn**2 * mp.cos(angle)
    return found[0], found[1], found[2]


def force(gear: Gear, t: mpf) -> mpf:
    """Return g."""
    _e, slope, bend = derivatives(gear, t)
    return mpf(gear.delta) * mpf(gear.drift) + bend + mpf(gear.delta) * slope


def state(gear: Gear, t0: mpf, w: mpf, s: mpf) -> tuple[mpf, mpf]:
    """Return Φ(s) − Φ(0) and Φ'(s) of a flight."""
    height0, slope0, _ = derivatives(gear, t0)
    height1, slope1, _ = derivatives(gear, t0 + s)
    delta, drift = mpf(gear.delta), mpf(gear.drift)
    a, decay = w - slope0 - drift, mp.exp(-delta * s)
    return drift * s + a * (1 - decay) / delta + height1 - height0, drift + a * decay + slope1


def first_impact(gear: Gear, wall: int, t0: float, w: float, most: float = 20.0) -> tuple[mpf, int, mpf]:
    """Return time, wall and velocity of the first impact.

    F and F' on a grid in doubles, of 40 points in a period of the highest harmonic and 200 more in the time of a short
    bounce, say which stretches come close to a wall; these are looked at in 40 digits, with their extremum.
    """
    upper = mpf(0) if wall > 0 else 2 * mpf(gear.beta)
    lower = upper - 2 * mpf(gear.beta)
    t, w_ = mpf(t0), mpf(w)
    highest = max(order for order, _a, _p in gear.harmonics)
    bounce = min(2 * abs(w) / abs(float(force(gear, t))), 1.0)
    even = np.arange(1, int(most * 40 * highest)) / (40 * highest)
    grid = np.unique(np.concatenate([[0.0], even, bounce * np.arange(1, 201) / 160]))
    heights, speeds = _in_doubles(gear, t0, w, grid)
    reach = np.maximum(np.abs(speeds[1:]), np.abs(speeds[:-1])) * np.diff(grid) + 1e-6
    turns = speeds[1:] * speeds[:-1] < 0
    close = (np.maximum(heights[1:], heights[:-1]) + reach > float(upper)) & ((speeds[1:] > 0) | turns)
    close |= (np.minimum(heights[1:], heights[:-1]) - reach < float(lower)) & ((speeds[1:] < 0) | turns)
    for i in np.flatnonzero(close):
        low, high = mpf(float(grid[i])), mpf(float(grid[i + 1]))
        marks = [high]
        if turns[i]:
            marks.insert(0, bisected(lambda s: state(gear, t, w_, s)[1], low, high))
        for mark in marks:
            height = state(gear, t, w_, mark)[0]
            for level, target in ((upper, 1), (lower, -1)):
                if target * (height - level) > 0:
                    end = bisected(lambda s, level=level: state(gear, t, w_, s)[0] - level, low, mark)
                    return end, target, state(gear, t, w_, end)[1]
            low = mark
    raise AssertionError("no impact")


def _in_doubles(gear: Gear, t0: float, w: float, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """F and F' at times s."""
    order, size, phase = np.array(gear.harmonics).T
    turn, amplitude = 2 * np.pi * order, gear.epsilon * size
    before, after = turn * t0 + 2 * np.pi * phase, turn * (t0 + s[:, None]) + 2 * np.pi * phase
    a = w + (amplitude * turn * np.sin(before)).sum() - gear.drift
    height = gear.drift * s - a * np.expm1(-gear.delta * s) / gear.delta
    height += (amplitude * (np.cos(after) - np.cos(before))).sum(axis=1)
    return height, gear.drift + a * np.exp(-gear.delta * s) - (amplitude * turn * np.sin(after)).sum(axis=1)


def bisected(function: Callable[[mpf], mpf], low: mpf, high: mpf) -> mpf:
    """Where a function takes the sign that it has at high, for the last time."""
    positive = function(high) > 0
    for _ in range(140):
        middle = (low + high) / 2
        if (function(middle) > 0) == positive:
            high = middle
        else:
            low = middle
    return (low + high) / 2
