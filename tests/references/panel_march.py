"""First impacts by panels (compiled): an algorithm that shares neither code nor argument with the library's kernel.

|F⁗| ≤ δ³|A| e^(−δs) + (2π)⁴ ε bounds the error of the cubic Taylor polynomial on a panel. Panels are halved until F
provably stays between the walls, or is convex, concave or monotone; there bisection finds turning point and crossing.
The closed form is the textbook's, in sines and exponentials of the C library, with series for short flights.
"""

import math

from compiled import compiled

TWO_PI = 2.0 * math.pi
LONGEST = 1000.0
PANEL = 0.12  # longest panel: there the cubic of a typical flight is good to 1e-2 of the gap
MOST_PANELS = 100_000
TINIEST = 1e-13  # below this panel two events cannot be told apart in double precision
FOUND, NOTHING = 0, 1


@compiled
def after_series(s, w, a, sin0, cos0, delta, epsilon):
    """F and F' for short flights, y = 2πs and δs below 0.5: fourteen terms of each Taylor series."""
    x, y = delta * s, TWO_PI * s
    term, sum0, sum1 = a * x, 0.0, 0.0  # a (−1)^(n+1) x^n/n!: F' adds it, F adds s times it over n + 1
    for n in range(1, 15):
        sum1 += term
        sum0 += term / (n + 1)
        term *= -x / (n + 1)
    omc, defect, siny, power = 0.0, 0.0, 0.0, 1.0
    for n in range(1, 15):
        power *= y / n
        sign = -1.0 if (n // 2) % 2 == 1 else 1.0
        if n % 2 == 1:
            siny += sign * power
            defect -= sign * power if n > 1 else 0.0
        else:
            omc -= sign * power
    f0 = s * (w + sum0) - epsilon * (cos0 * omc - sin0 * defect)
    return f0, w + sum1 - TWO_PI * epsilon * (cos0 * siny - sin0 * omc)


@compiled
def after(s, theta, w, a, sin0, cos0, delta, epsilon):
    """F, F', F'', F''' and e^(−δs) after s from phase θ/2π."""
    decay, lost = math.exp(-delta * s), -math.expm1(-delta * s)
    sin1, cos1 = math.sin(theta + TWO_PI * s), math.cos(theta + TWO_PI * s)
    if max(TWO_PI * s, abs(delta) * s) < 0.5:
        f0, f1 = after_series(s, w, a, sin0, cos0, delta, epsilon)
    else:
        f0 = (w + a) * s - a * lost / delta + epsilon * (cos1 - cos0 + TWO_PI * s * sin0)
        f1 = w + a * lost - TWO_PI * epsilon * (sin1 - sin0)
    f2 = delta * a * decay - TWO_PI**2 * epsilon * cos1
    return f0, f1, f2, TWO_PI**3 * epsilon * sin1 - delta * delta * a * decay, decay


@compiled
def bisected(lo, hi, order, level, rising, theta, w, a, sin0, cos0, delta, epsilon):
    """Return the point of (lo, hi) where F (order 0) or F' (order 1), monotone there, crosses the level."""
    for _ in range(200):
        f = after(lo, theta, w, a, sin0, cos0, delta, epsilon)[order] - level
        g = after(hi, theta, w, a, sin0, cos0, delta, epsilon)[order] - level
        width = hi - lo
        s = lo - f * width / (g - f) if g != f else 0.5 * (lo + hi)
        d = 1e-3 * width
        for trial in (s - d, s + d, 0.5 * (lo + hi)):  # two points beside the secant's, so that both ends close in
            if lo < trial < hi:
                if (after(trial, theta, w, a, sin0, cos0, delta, epsilon)[order] > level) == rising:
                    hi = trial
                else:
                    lo = trial
        if not hi - lo > 4e-16 * hi or not hi - lo < width:
            break
    return 0.5 * (lo + hi)


@compiled
def stays_inside(f0, f1, f2, f3, h, remainder, lower, upper):
    """True if the cubic Taylor polynomial's Bernstein hull, widened by the remainder, keeps off both walls."""
    b1 = f0 + f1 * h / 3.0
    b2 = f0 + f1 * (2.0 * h / 3.0) + f2 * (h * h / 6.0)
    b3 = f0 + h * (f1 + h * (0.5 * f2 + h * f3 / 6.0))
    highest = max(max(f0, b1), max(b2, b3))
    lowest = min(min(f0, b1), min(b2, b3))
    return highest + remainder < upper and lowest - remainder > lower


@compiled
def panel(s, h, f0, f1, f2, f3, m4, epsilon, beta, lower, upper):
    """The longest panel, by halving, on which F provably stays inside (True), or bends or slopes one way (False)."""
    while True:
        rounding = 4.0e-15 * (abs(f0) + abs(f1) * h + epsilon + 1e-3 * beta)
        if s > 0.0 and stays_inside(f0, f1, f2, f3, h, m4 * h**4 / 24.0 + rounding, lower, upper):
            return h, True
        bend = 0.5 * m4 * h * h
        if min(f2, f2 + f3 * h) - bend > 0.0 or max(f2, f2 + f3 * h) + bend < 0.0 or h < TINIEST:
            return h, False
        c1, c2 = f1 + 0.5 * f2 * h, f1 + h * (f2 + 0.5 * f3 * h)
        tilt = m4 * h * h * h / 6.0
        if min(f1, min(c1, c2)) - tilt > 0.0 or max(f1, max(c1, c2)) + tilt < 0.0:
            return h, False
        h *= 0.5


@compiled
def march(wall, tau, w, delta, epsilon, beta, drift):
    """The first impact after leaving a wall at phase tau with velocity w into the gap: (status, wall, time)."""
    theta = TWO_PI * tau
    sin0, cos0 = math.sin(theta), math.cos(theta)
    a = drift - TWO_PI * epsilon * sin0 - w
    upper = 0.0 if wall > 0 else 2.0 * beta
    lower = upper - 2.0 * beta
    growth = math.exp(-delta * PANEL) if delta < 0.0 else 1.0
    s, h = 0.0, PANEL
    f0, f1, f2, f3, decay = after(s, theta, w, a, sin0, cos0, delta, epsilon)
    for _ in range(MOST_PANELS):
        m4 = abs(delta * delta * delta * a) * decay * growth + TWO_PI**4 * epsilon
        if not (m4 < math.inf and s < LONGEST):
            break
        h, inside = panel(s, min(1.7 * h, PANEL), f0, f1, f2, f3, m4, epsilon, beta, lower, upper)
        e = s + h
        e0, e1, e2, e3, e_decay = after(e, theta, w, a, sin0, cos0, delta, epsilon)
        if not inside:
            turn, at_turn = s, f0
            if (f1 < 0.0 < e1 or e1 < 0.0 < f1) and h >= TINIEST:
                turn = bisected(s, e, 1, 0.0, e1 > 0.0, theta, w, a, sin0, cos0, delta, epsilon)
                at_turn = after(turn, theta, w, a, sin0, cos0, delta, epsilon)[0]
            for lo, hi, start, end in ((s, turn, f0, at_turn), (turn, e, at_turn, e0)):
                hit = 1 if end > start and end > upper else -1 if end < start and end < lower else 0
                if hit != 0:
                    level = upper if hit > 0 else lower
                    return FOUND, hit, bisected(lo, hi, 0, level, hit > 0, theta, w, a, sin0, cos0, delta, epsilon)
        s, f0, f1, f2, f3, decay = e, e0, e1, e2, e3, e_decay
    return NOTHING, 0, s


@compiled
def depth(tau, w, delta, epsilon, longest):
    """The lowest F on [0, longest] of a flight without walls, on a grid of 1/1024 refined where F' changes sign."""
    theta = TWO_PI * tau
    sin0, cos0 = math.sin(theta), math.cos(theta)
    a = 2.0 * TWO_PI - TWO_PI * epsilon * sin0 - w
    lowest, s, f1 = 0.0, 0.0, w
    while s < longest:
        e = min(s + 1.0 / 1024.0, longest)
        e0, e1, _e2, _e3, _d = after(e, theta, w, a, sin0, cos0, delta, epsilon)
        if f1 < 0.0 < e1:
            turn = bisected(s, e, 1, 0.0, True, theta, w, a, sin0, cos0, delta, epsilon)
            lowest = min(lowest, after(turn, theta, w, a, sin0, cos0, delta, epsilon)[0])
        lowest = min(lowest, e0)
        s, f1 = e, e1
    return lowest
