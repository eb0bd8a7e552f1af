"""The first impact of a flight: Newton with a proof of convexity, else a march that cannot skip a crossing (compiled).

The paper assumes one minimum and no maximum on every flight; docs/decisions/0001-first-impact.md says where that fails.
"""

import math

from rattle._compile import kernel
from rattle.flight import DRIFT, TWO_PI, evaluate, third_derivative, versines

OK = 0
NO_IMPACT = 1  # no impact within LONGEST forcing periods: only backwards in time, or on non-finite input
LONGEST = 1000.0

PANEL = 0.12  # longest march step: there the cubic of a typical flight is good to 1e-2 of the gap
MOST_PANELS = 100_000  # ten times what LONGEST takes; only parameters beyond all measure need more
TINIEST = 1e-13  # below this panel two events cannot be told apart in double precision


@kernel
def root_in(lo, hi, guess, level, rising, w, a, sin0, cos0, delta, epsilon):
    """The crossing F = level in (lo, hi), where F is monotone: Halley steps u kept inside a shrinking bracket.

    A step leaves an error of u³ (p² + |F‴/6F'|) with p = F''/2F'; the last one leaves less than rounding.
    """
    s = guess
    if not (lo < s < hi):
        s = 0.5 * (lo + hi)
    for _ in range(100):
        f0, f1, f2, decay, sin1, _c = evaluate(s, w, a, sin0, cos0, delta, epsilon)
        f0 -= level
        if (f0 > 0.0) == rising:
            hi = s
        else:
            lo = s
        u, p = -f0 / f1, 0.5 * f2 / f1
        u /= 1.0 + u * p
        bend = p * p + abs(third_derivative(a, decay, sin1, delta, epsilon) / f1)
        new = s + u
        if not (lo <= new <= hi):
            new = 0.5 * (lo + hi)
        elif abs(u) * u * u * bend < 1e-17 * s:
            return new
        if new == s or lo == hi:
            return new
        s = new
    return s


@kernel
def extremum_in(lo, hi, convex, w, a, sin0, cos0, delta, epsilon):
    """The zero of F' in (lo, hi), where F'' keeps its sign, to 1e-9: F there is then exact to rounding."""
    s = 0.5 * (lo + hi)
    for _ in range(100):
        _f0, f1, f2, decay, sin1, _c = evaluate(s, w, a, sin0, cos0, delta, epsilon)
        if (f1 > 0.0) == convex:
            hi = s
        else:
            lo = s
        u = -f1 / f2
        new = s + u
        if not (lo <= new <= hi):
            new = 0.5 * (lo + hi)
        elif u * u * abs(third_derivative(a, decay, sin1, delta, epsilon) / f2) < 1e-9 * min(s, 1.0):
            return new
        if new == s or lo == hi:
            return new
        s = new
    return s


@kernel
def stays_inside(f0, f1, f2, f3, h, remainder, lower, upper):
    """True if the cubic Taylor polynomial's Bernstein hull, widened by the remainder, keeps off both walls."""
    b1 = f0 + f1 * h / 3.0
    b2 = f0 + f1 * (2.0 * h / 3.0) + f2 * (h * h / 6.0)
    b3 = f0 + h * (f1 + h * (0.5 * f2 + h * f3 / 6.0))
    highest = max(max(f0, b1), max(b2, b3))
    lowest = min(min(f0, b1), min(b2, b3))
    return highest + remainder < upper and lowest - remainder > lower


@kernel
def impact_on_piece(s0, s1, start, end, guess, lower, upper, w, a, sin0, cos0, delta, epsilon):
    """The crossing, if any, on a monotone piece from F = start to F = end: (wall or 0, time)."""
    wall = 1 if end > start and end > upper else -1 if end < start and end < lower else 0
    if wall == 0:
        return 0, s1
    level = upper if wall > 0 else lower
    if math.isnan(guess):
        guess = s0 + (level - start) / (end - start) * (s1 - s0)
    return wall, root_in(s0, s1, guess, level, wall > 0, w, a, sin0, cos0, delta, epsilon)


@kernel
def panel(s, h, f0, f1, f2, f3, m4, epsilon, beta, lower, upper):
    """The longest panel, by halving from h, on which F provably stays inside (True), or bends or slopes one way
    (False).
    """
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


@kernel
def march(wall, w, a, sin0, cos0, delta, epsilon, beta):
    """First impact by panels on which F provably stays inside, or is convex, concave or monotone: no crossing is
    skipped.

    |F''''| ≤ δ³|A| e^(−δs) + (2π)⁴ ε bounds the error of the cubic on a panel. Returns (status, wall, time).
    """
    upper = 0.0 if wall > 0 else 2.0 * beta
    lower = upper - 2.0 * beta
    growth = math.exp(-delta * PANEL) if delta < 0.0 else 1.0
    s, h = 0.0, PANEL
    f0, f1, f2, decay, sin1, _cos1 = evaluate(s, w, a, sin0, cos0, delta, epsilon)
    panels = 0
    while s < LONGEST and panels < MOST_PANELS:
        f3 = third_derivative(a, decay, sin1, delta, epsilon)
        m4 = abs(delta * delta * delta * a) * decay * growth + TWO_PI**4 * epsilon
        if not m4 < math.inf:
            break
        panels += 1
        h, inside = panel(s, min(1.7 * h, PANEL), f0, f1, f2, f3, m4, epsilon, beta, lower, upper)
        e = s + h
        e0, e1, e2, e_decay, e_sin, _c = evaluate(e, w, a, sin0, cos0, delta, epsilon)
        if not inside:
            first, x0 = s, f0
            if (f1 < 0.0 < e1 or e1 < 0.0 < f1) and h >= TINIEST:
                first = extremum_in(s, e, e1 > 0.0, w, a, sin0, cos0, delta, epsilon)
                x0 = evaluate(first, w, a, sin0, cos0, delta, epsilon)[0]
                hit, t = impact_on_piece(s, first, f0, x0, math.nan, lower, upper, w, a, sin0, cos0, delta, epsilon)
                if hit != 0:
                    return OK, hit, t
            guess = 2.0 * first if s == 0.0 else math.nan  # a small bounce is a parabola
            hit, t = impact_on_piece(first, e, x0, e0, guess, lower, upper, w, a, sin0, cos0, delta, epsilon)
            if hit != 0:
                return OK, hit, t
        s, f0, f1, f2, decay, sin1 = e, e0, e1, e2, e_decay, e_sin
    return NO_IMPACT, 0, s


@kernel
def convex_to_the_end(w1, decay, cos0, tau0, s, cos1, a, delta, epsilon):
    """True if F'' > 0 is certain on the whole flight that ends after s with speed w1.

    Either w1 stays below q − 2πε √(1 + 4π²/δ²): F'' > 0 wherever F' is below it, so F' cannot have been above and
    come back. Or the decaying part of F'' at its end (its smallest value) outweighs the largest 4π²ε cos 2πt of the
    flight.
    """
    if w1 < DRIFT - TWO_PI * epsilon * math.sqrt(1.0 + TWO_PI * TWO_PI / (delta * delta)) - 1e-9:
        return True
    crest = 1.0 if tau0 + s >= 1.0 else max(cos0, cos1)
    return delta * a * decay > TWO_PI * TWO_PI * epsilon * crest + 1e-9


@kernel
def descend(w, a, sin0, cos0, delta, epsilon, lower):
    """Walk to the minimum of a convex flight from Σ⁺ until it is clear which wall comes next.

    Returns (side, s, F, F', F''): side −1 if F falls below lower, +1 if it provably does not, 0 if undecided. With
    F'' ≥ F''(s)/2 within u = 2|F'|/F'' of s, the minimum lies there and is at least F − F'²/F''.
    """
    speed = -w
    s = speed / max(0.5 * (delta * a - TWO_PI * TWO_PI * epsilon * cos0) + TWO_PI * delta, 0.5 * delta)
    f0, f1, f2 = 0.0, w, 0.0
    for _ in range(12):
        f0, f1, f2, decay, sin1, _c = evaluate(s, w, a, sin0, cos0, delta, epsilon)
        if f0 < lower and f1 < 0.0:
            return -1, s, f0, f1, f2
        if f2 <= 0.0:
            return 0, s, f0, f1, f2
        reach = 2.0 * abs(f1) / f2
        f3 = third_derivative(a, decay, sin1, delta, epsilon)
        m4 = abs(delta * delta * delta * a) * decay * math.exp(delta * reach) + TWO_PI**4 * epsilon
        if reach * (abs(f3) + 0.5 * m4 * reach) < 0.5 * f2:
            if f0 - f1 * f1 / f2 > lower:
                return 1, s, f0, f1, f2
            if f0 < lower:
                return -1, s, f0, f1, f2
        s = max(s - f1 / f2 * (1.0 + 0.5 * f1 * f3 / (f2 * f2)), 0.05 * s)
    return 0, s, f0, f1, f2


@kernel
def polish(s, level, w, a, sin0, cos0, delta, epsilon):
    """Fourth-order steps to F = level from a close guess: (arrived, s, F', e^(−δs), sin, cos there).

    The state after the last step u ≤ 1e-5 s comes from its Taylor series, whose error is of the order of u⁴.
    """
    for _ in range(6):
        f0, f1, f2, decay, sin1, cos1 = evaluate(s, w, a, sin0, cos0, delta, epsilon)
        f3 = third_derivative(a, decay, sin1, delta, epsilon)
        inverse = 1.0 / f1
        u = (level - f0) * inverse
        p = 0.5 * f2 * inverse
        u *= 1.0 - u * (p - u * (2.0 * p * p - f3 * inverse * (1.0 / 6.0)))
        s += u
        if abs(u) < 1e-5 * min(s, 1.0):
            y, x = TWO_PI * u, delta * u
            f1 += u * (f2 + 0.5 * u * f3)
            decay *= 1.0 - x * (1.0 - x * (0.5 - x * (1.0 / 6.0)))
            sin2 = sin1 + y * (cos1 - y * (0.5 * sin1 + y * (1.0 / 6.0) * cos1))
            return True, s, f1, decay, sin2, cos1 - y * (sin1 + y * (0.5 * cos1 - y * (1.0 / 6.0) * sin1))
    return False, s, 0.0, 0.0, 0.0, 0.0


@kernel
def convex_impact(wall, tau0, w, a, sin0, cos0, delta, epsilon, beta):
    """First impact by Newton's method with a proof that it is the first: (proved, wall, time, F', e^(−δs), sin,
    cos).
    """
    target, level = 1, 0.0
    if wall > 0:
        side, s, f0, f1, f2 = descend(w, a, sin0, cos0, delta, epsilon, -2.0 * beta)
        if side < 0:
            target, level = -1, -2.0 * beta
        root = math.sqrt(max(f1 * f1 - 2.0 * f2 * (f0 - level), 0.0))
        s += (target * root - f1) / f2
        known = side != 0 and s > 0.0
    else:
        level = 2.0 * beta
        s = 2.0 * level / (w + math.sqrt(w * w + 2.0 * level * DRIFT * delta))
        known = True
    arrived, s, w1, decay, sin1, cos1 = polish(s, level, w, a, sin0, cos0, delta, epsilon)
    proved = known and arrived and s > 0.0 and target * w1 > 0.0
    proved = proved and convex_to_the_end(w1, decay, cos0, tau0, s, cos1, a, delta, epsilon)
    return proved, target, s, w1, decay, sin1, cos1


@kernel
def first_impact(wall, tau, w, delta, epsilon, beta, drift):
    """First impact after leaving a wall at phase tau ∈ [0, 1) with velocity w into the gap.

    Returns (status, time, wall, velocity before reflection, e^(−δ time), sin, cos of 2π phase at departure, at
    arrival).
    """
    versine, sin0, _defect = versines(tau)
    cos0 = 1.0 - versine
    a = drift - TWO_PI * epsilon * sin0 - w
    if delta > 0.0:
        proved, target, s, w1, decay, sin1, cos1 = convex_impact(wall, tau, w, a, sin0, cos0, delta, epsilon, beta)
        if proved:
            return OK, s, target, w1, decay, sin0, cos0, sin1, cos1
    status, target, s = march(wall, w, a, sin0, cos0, delta, epsilon, beta)
    _f0, w1, _f2, decay, sin1, cos1 = evaluate(s, w, a, sin0, cos0, delta, epsilon)
    w1 = target * max(target * w1, 0.0)  # a graze to the last bit arrives with speed 0, never backwards
    return status, s, target, w1, decay, sin0, cos0, sin1, cos1
