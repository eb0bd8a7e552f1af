"""Random flights for comparing the library's first impacts (compiled), near grazing ones among them."""

import math

import numpy as np
import panel_march
from compiled import compiled

from rattle.flight.first_impact import first_impact_by_safe_search, guess_first_impact
from rattle.flight.forcing import DRIFT, TWO_PI
from rattle.flight.law import flight_from_phase

SEEN = ("flights", "proved", "no_impact", "marched", "wrong_wall", "late", "march_wall", "march_time")
FLIGHTS, PROVED, NO_IMPACT, MARCHED, WRONG_WALL, LATE, MARCH_WALL, MARCH_TIME = range(len(SEEN))
PLANE, WIDE, ARCS = range(3)  # arcs: above the quiet limit, where the contact force changes sign
STEP = 1.0 / 16.0


@compiled
def log_uniform(low, high):
    """A number whose logarithm is uniform."""
    return low * math.exp(np.random.random() * math.log(high / low))


@compiled
def turning_height(wall, tau, w, delta, epsilon, order):
    """F where a flight that knows no walls turns back for the order-th time, or the last before it; NaN without one."""
    theta = TWO_PI * tau
    sin0, cos0 = math.sin(theta), math.cos(theta)
    a = DRIFT - TWO_PI * epsilon * sin0 - w
    s, f1, turns, height = 0.0, w, 0, math.nan
    while s < 6.0 and turns < order:
        e = s + STEP
        e0, e1, _e2, _e3, _d = panel_march.after(e, theta, w, a, sin0, cos0, delta, epsilon)
        if wall * f1 < 0.0 < wall * e1:  # F' starts with the sign of −wall
            t = s - f1 * (e - s) / (e1 - f1)
            for _ in range(8):
                x0, x1, x2, _x3, _d = panel_march.after(t, theta, w, a, sin0, cos0, delta, epsilon)
                t = min(max(t - x1 / x2, s), e)
                if abs(x1) < 1e-9 * abs(x2) * s:
                    break
            height = x0 if abs(x1) < 1e-7 * abs(x2) else height
            turns += 1
        if wall * e0 > 0.0:
            break
        s, f1 = e, e1
    return height


@compiled
def peak_height(tau, w, delta, epsilon):
    """F at its first maximum after leaving Σ⁺, in a flight that knows no walls; NaN without one."""
    theta = TWO_PI * tau
    sin0, cos0 = math.sin(theta), math.cos(theta)
    a = DRIFT - TWO_PI * epsilon * sin0 - w
    s, f1, turned = 0.0, w, False
    while s < 2.0:
        e = s + STEP
        _e0, e1, _e2, _e3, _d = panel_march.after(e, theta, w, a, sin0, cos0, delta, epsilon)
        turned = turned or e1 > 0.0
        if turned and f1 > 0.0 > e1:
            t = panel_march.bisected(s, e, 1, 0.0, False, theta, w, a, sin0, cos0, delta, epsilon)
            return panel_march.after(t, theta, w, a, sin0, cos0, delta, epsilon)[0]
        s, f1 = e, e1
    return math.nan


@compiled
def speed_with_peak(tau, delta, epsilon, off):
    """A speed at which the first maximum after Σ⁺ lies off above it, or a random one if there is none."""
    lo, below = 0.05, peak_height(tau, -0.05, delta, epsilon) - off
    for k in range(1, 25):
        hi = 0.05 + 8.0 * k / 24
        above = peak_height(tau, -hi, delta, epsilon) - off
        if below * above < 0.0:
            for _ in range(60):
                v = 0.5 * (lo + hi)
                if (peak_height(tau, -v, delta, epsilon) - off) * below > 0.0:
                    lo = v
                else:
                    hi = v
            return 0.5 * (lo + hi)
        lo, below = hi, above
    return np.random.uniform(0.05, 6.0)


@compiled
def random_flight(regime, near):
    """(wall, τ, w, δ, ε, β); near: β is such that F turns a log-uniform 1e-12…1e-3 above or below the other wall."""
    if regime == PLANE:
        delta, epsilon, beta = np.random.uniform(0.2, 1.5), np.random.uniform(0.0, 0.4), np.random.uniform(0.2, 1.2)
    elif regime == ARCS:
        delta, beta = np.random.uniform(0.2, 1.5), np.random.uniform(0.05, 1.2)
        epsilon = 2.0 * delta / math.hypot(TWO_PI, delta) * np.random.uniform(1.0, 2.5)
    else:
        delta, epsilon, beta = log_uniform(0.02, 5.0), log_uniform(0.05, 5.0), log_uniform(0.01, 5.0)
        epsilon = 0.0 if np.random.random() < 0.02 else epsilon
    wall = 1 if np.random.random() < 0.7 else -1
    v = log_uniform(1e-6, 15.0) if np.random.random() < 0.5 else np.random.uniform(1e-6, 15.0)
    tau = np.random.random()
    if regime == ARCS:
        wall, v = 1, np.random.uniform(0.05, 6.0)
        if near and np.random.random() < 0.5:
            off = log_uniform(1e-12, 1e-3) * (1.0 if np.random.random() < 0.5 else -1.0)
            return wall, tau, -speed_with_peak(tau, delta, epsilon, off), delta, epsilon, beta
    if near:
        v = np.random.uniform(0.5, 15.0) if regime != ARCS else v
        wall = 1 if regime != WIDE or np.random.random() < 0.7 else -1
        depth = abs(turning_height(wall, tau, -wall * v, delta, epsilon, 1 if np.random.random() < 0.5 else 2))
        off = log_uniform(1e-12, 1e-3) * (1.0 if np.random.random() < 0.5 else -1.0)
        if depth + off > 0.01:
            beta = 0.5 * (depth + off)
    return wall, tau, -wall * v, delta, epsilon, beta


@compiled
def compare(n, seed, regime, near_share, march_every, time_error):
    """Fly n flights by proof and search, every march_every-th by panels: (counts as SEEN, worst time, first misses)."""
    np.random.seed(seed)
    seen = np.zeros(8, np.int64)
    misses, missed = np.zeros((8, 7)), 0
    worst = 0.0
    for k in range(n):
        wall, tau, w, delta, epsilon, beta = random_flight(regime, np.random.random() < near_share)
        flight = flight_from_phase(tau, w, delta, epsilon, DRIFT)
        proved, target, s, _w1, _l, _s1, _c1 = guess_first_impact(wall, tau, flight, beta)
        found = first_impact_by_safe_search(wall, tau, flight, beta)
        status, safe_s, safe_target, w1 = found[0], found[1], found[2], found[3]
        seen[FLIGHTS] += 1
        seen[NO_IMPACT] += status != 0
        bad = -1
        if proved:
            seen[PROVED] += 1
            error = abs(s - safe_s) / safe_s
            if status != 0 or target != safe_target:
                bad = WRONG_WALL
            else:
                worst = max(worst, error)
                bad = LATE if error > time_error else -1
        if bad < 0 and k % march_every == 0:
            seen[MARCHED] += 1
            march_status, march_target, march_s = panel_march.march(wall, tau, w, delta, epsilon, beta, DRIFT)
            scale = (abs(w) + abs(flight.a)) * safe_s + epsilon + beta
            allowed = 1e-12 * safe_s + 3e-15 * scale / max(abs(w1), 1e-30)
            if march_status != status or march_target != safe_target:
                bad = MARCH_WALL
            elif status == 0 and abs(march_s - safe_s) > allowed:
                bad = MARCH_TIME
        if bad >= 0:
            seen[bad] += 1
            if missed < misses.shape[0]:
                misses[missed] = np.array((float(bad), float(wall), tau, w, delta, epsilon, beta))
                missed += 1
    return seen, worst, misses[:missed]


@compiled
def random_states(n, seed, regime, near_share):
    """States on Σ⁺ as columns τ, v, δ, ε, β."""
    np.random.seed(seed)
    states = np.zeros((5, n))
    for k in range(n):
        wall = -1
        while wall < 0:
            wall, tau, w, delta, epsilon, beta = random_flight(regime, np.random.random() < near_share)
        states[0, k], states[1, k], states[2, k], states[3, k], states[4, k] = tau, abs(w), delta, epsilon, beta
    return states
