"""A brute force of the inelastic gear: small steps, bisection, no code of the library.

A flight is looked at in steps of a 32nd of the period of the highest harmonic, or of a bounce; an impact between two
looks is bisected. A motion on a wall that is slower than SLOW times the largest speed, while the force presses, sticks
until the force turns, which a scan finds. So chatter is followed impact by impact, and nothing is known of zeros.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from numba import njit

TWO_PI = 2.0 * math.pi
SLOW = 1e-7
IMPACT, CONTACT, RELEASE = 1, 2, 3
MOST_PERIOD = 16


@njit(cache=True)
def forced(t, orders, sizes, phases):
    """e, e' and e''."""
    e0, e1, e2 = 0.0, 0.0, 0.0
    for k in range(orders.size):
        w = TWO_PI * orders[k]
        a = w * t + TWO_PI * phases[k]
        e0 += sizes[k] * math.cos(a)
        e1 -= sizes[k] * w * math.sin(a)
        e2 -= sizes[k] * w * w * math.cos(a)
    return e0, e1, e2


@njit(cache=True)
def pressing(t, delta, drift, orders, sizes, phases):
    """The contact force."""
    _e0, e1, e2 = forced(t, orders, sizes, phases)
    return delta * drift + e2 + delta * e1


@njit(cache=True)
def after(s, t, w, delta, drift, orders, sizes, phases, e0, e1):
    """Φ(s) − Φ(0) and Φ'(s)."""
    f0, f1, _f2 = forced(t + s, orders, sizes, phases)
    a, p = w - e1 - drift, math.exp(-delta * s)
    return drift * s + a * (-math.expm1(-delta * s)) / delta + f0 - e0, drift + a * p + f1


@njit(cache=True)
def fly(wall, t, w, delta, drift, beta, orders, sizes, phases):
    """The first impact: (time, wall, velocity); wall 0 if none within 1000 periods."""
    e0, e1, e2 = forced(t, orders, sizes, phases)
    upper = 0.0 if wall > 0 else 2.0 * beta
    lower = upper - 2.0 * beta
    longest = 1.0 / (32.0 * orders.max())
    pull = wall * (delta * drift + e2 + delta * e1)
    h = longest
    if pull > 0.0 and w != 0.0:
        h = min(h, 2.0 * abs(w) / pull / 16.0)
    s, left = 0.0, False
    while s < 1000.0:
        f, _v = after(s + h, t, w, delta, drift, orders, sizes, phases, e0, e1)
        if not left and wall * f < 0.0:
            left = True
        elif not left:  # it came back within the first look, or has not left yet by rounding
            h *= 0.25
            if h < 1e-13:
                return h, wall, 0.0
            continue
        hit = 1 if f >= upper else -1 if f <= lower else 0
        if hit != 0:
            low, high = s, s + h
            for _ in range(70):
                m = 0.5 * (low + high)
                x, _v = after(m, t, w, delta, drift, orders, sizes, phases, e0, e1)
                if (hit > 0 and x >= upper) or (hit < 0 and x <= lower):
                    high = m
                else:
                    low = m
            return high, hit, after(high, t, w, delta, drift, orders, sizes, phases, e0, e1)[1]
        s += h
        h = min(longest, 1.5 * h)
    return s, 0, 0.0


@njit(cache=True)
def march(t, w, wall, until, delta, drift, beta, r, slow, orders, sizes, phases, events):
    """Follow a motion: (number of events, t, w, wall, quiet). events (n, 4): time, kind, wall, speed of arrival."""
    n = 0
    step = 1.0 / (256.0 * orders.max())
    while t < until:
        if abs(w) < slow and wall * pressing(t, delta, drift, orders, sizes, phases) > 0.0:
            if n < events.shape[0]:
                events[n, 0], events[n, 1], events[n, 2], events[n, 3] = t, 2, wall, 0.0
            n += 1
            low, high = t, t + step
            while wall * pressing(high, delta, drift, orders, sizes, phases) > 0.0:
                low, high = high, high + step
                if high > t + 1.0 + 2.0 * step:
                    return n, t, 0.0, wall, True
            for _ in range(60):
                m = 0.5 * (low + high)
                if wall * pressing(m, delta, drift, orders, sizes, phases) > 0.0:
                    low = m
                else:
                    high = m
            t, w = high, -wall * 1e-12
            if n < events.shape[0]:
                events[n, 0], events[n, 1], events[n, 2], events[n, 3] = t, 3, wall, 0.0
            n += 1
            continue
        s, hit, v = fly(wall, t, w, delta, drift, beta, orders, sizes, phases)
        if hit == 0:
            return n, t, w, wall, False
        t += s
        wall, w = hit, -r * v
        if n < events.shape[0]:
            events[n, 0], events[n, 1], events[n, 2], events[n, 3] = t, 1, wall, abs(v)
        n += 1
    return n, t, w, wall, False


def merged(events: np.ndarray) -> np.ndarray:
    """Events without the impacts of runs that end in contact: each such run is its CONTACT."""
    keep = np.ones(len(events), bool)
    for i in np.flatnonzero(events[:, 1] == CONTACT):
        j = i - 1
        while j >= 0 and events[j, 1] == IMPACT and events[j, 2] == events[i, 2]:
            keep[j] = False
            j -= 1
    return events[keep]


def label(events: np.ndarray, now: float, scale: float) -> str:
    """The label of a motion by its events in the last 2 MOST_PERIOD + 4 periods, "other" if none repeats."""
    events = merged(events)
    marks = events[events[:, 1] != RELEASE]
    releases = events[events[:, 1] == RELEASE]
    recent = marks[marks[:, 0] > now - 4.0, 0]
    if len(recent) < 2:
        return "other"
    widest = int(np.argmax(np.diff(recent)))
    end = 0.5 * float(recent[widest] + recent[widest + 1])  # no impact is at the end of a window
    for m in range(1, MOST_PERIOD + 1):
        last, before = (
            marks[(marks[:, 0] > end - m - shift) & (marks[:, 0] <= end - shift)] for shift in (0.0, float(m))
        )
        if len(last) != len(before) or len(last) == 0:
            continue
        same_time = np.allclose(last[:, 0] - m, before[:, 0], atol=2e-4)
        same = np.array_equal(last[:, 1:3], before[:, 1:3]) and np.allclose(last[:, 3], before[:, 3], atol=2e-4 * scale)
        if same_time and same:
            n_plus, n_minus = int((last[:, 2] > 0).sum()), int((last[:, 2] < 0).sum())
            contacts = int(((releases[:, 0] > end - m) & (releases[:, 0] <= end)).sum())
            return f"P({m},{n_plus},{n_minus}" + (f";{contacts})" if contacts else ")")
    return "other"


def shares(
    delta: float,
    epsilon: float,
    beta: float,
    r: float,
    load: float,
    harmonics: list[tuple[int, float, float]],
    tau: np.ndarray,
    v: np.ndarray,
    periods: float,
) -> Counter[str]:
    """How many of these states (n,) end in which motion, by its label."""
    orders = np.array([1.0, *(float(k) for k, _a, _p in harmonics)])
    sizes = epsilon * np.array([1.0, *(a for _k, a, _p in harmonics)])
    phases = np.array([0.0, *(p for _k, _a, p in harmonics)])
    scale = float(max(v.max(), 1e-300))
    numbers = delta, 4.0 * math.pi * (1.0 + load), beta, r, SLOW * scale, orders, sizes, phases
    found: Counter[str] = Counter()
    none = np.zeros((0, 4))
    for t, speed in zip(tau, v, strict=True):
        _n, now, w, wall, quiet = march(float(t), -float(speed), 1, float(t) + periods, *numbers, none)
        if not quiet:
            span = 2 * MOST_PERIOD + 4
            events = np.zeros((200_000, 4))
            n, end, _w, _wall, quiet = march(now, w, wall, now + span, *numbers, events)
            if not quiet:
                found[label(events[:n], max(end, now + span), scale)] += 1
                continue
        found["quiet"] += 1
    return found
