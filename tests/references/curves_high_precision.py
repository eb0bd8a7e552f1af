"""The bifurcation curves in 40 digits, from the differential equation and the impact law alone.

An orbit is a cycle of impacts (phase, velocity after it) that free flights join, and a curve is one more equation: a
multiplier that is 1 (fold) or −1 (flip), or a flight whose minimum lies on Σ⁻ (graze). All unknowns, ε or δ among them,
are found together by Newton's method; nothing is eliminated. Guesses are rounded to six digits, so that agreement in
ten is the work of the equations, and come from a scan in doubles over all orbits, not from the library.
"""

from typing import NamedTuple

import numpy as np
from high_precision import Flight
from mpmath import mp, mpf
from stored import stored

RESIDUAL = mpf(10) ** -30
STEP = mpf(10) ** -9  # to a neighbouring orbit
NEAR = 1e-3  # the solution is the one that was guessed, not another one
DEPTH = 1e-9  # a flight that is this far beyond a wall crossed it
TWO_PI = 2 * np.pi


class NotFoundError(Exception):
    """The equations have no solution near the guess, or one of another curve, or one that is not admissible."""


class Cycle:
    """A closed orbit of period 1: times and velocities after its impact on Σ⁺ and, if there are two, on Σ⁻."""

    def __init__(self, times, velocities, delta, epsilon, beta):
        self.times, self.velocities = list(times), list(velocities)
        self.walls = (1, -1)[: len(self.times)]
        self.delta, self.epsilon, self.beta = mpf(delta), mpf(epsilon), mpf(beta)

    def legs(self):
        """(wall, t0, w0, next wall, t1, w1) of every flight, w1 before the impact that ends it."""
        n = len(self.times)
        for i in range(n):
            j = (i + 1) % n
            end = self.times[j] + (1 if j == 0 else 0)
            yield self.walls[i], self.times[i], self.velocities[i], self.walls[j], end, -self.velocities[j]

    def flight(self, i=0):
        return Flight(self.walls[i], self.times[i], self.velocities[i], self.delta, self.epsilon, self.beta)

    def force(self, t):
        """Right-hand side of the differential equation; also the contact force of a gear at rest on Σ⁺."""
        return force(t, self.delta, self.epsilon)

    def closure(self):
        """Return the errors of the flights: position and velocity at every impact."""
        missed = []
        for i, (_, t0, _, wall, t1, w1) in enumerate(self.legs()):
            flight = self.flight(i)
            missed += [flight.position(t1 - t0) - wall * flight.beta, flight.velocity(t1 - t0) - w1]
        return missed

    def characteristic(self, multiplier):
        """Determinant that vanishes where a perturbation returns multiplied; regular also at speed 0.

        A flight that starts dt later with velocity w + dw differs from the old one by −w dt in place and dw − Φ'' dt in
        velocity; a difference y obeys y'' + δ y' = 0; the wall is met where w₁ dt₁ + y = 0, with dw₁ = y' + Φ'' dt₁.
        """
        n = len(self.times)
        matrix = mp.zeros(2 * n)
        for i, (_, t0, w0, _, t1, w1) in enumerate(self.legs()):
            decay = mp.exp(-self.delta * (t1 - t0))
            drift = (1 - decay) / self.delta
            a0, a1 = self.force(t0) - self.delta * w0, self.force(t1) - self.delta * w1
            start = ((-w0 - a0 * drift, drift), (-a0 * decay, decay))
            end = ((w1, 0), (a1, 1))  # of the velocity after the impact, −w₁
            j = (i + 1) % n
            for row in range(2):
                for column in range(2):
                    matrix[2 * i + row, 2 * i + column] += start[row][column]
                    matrix[2 * i + row, 2 * j + column] += end[row][column] * (multiplier if j == 0 else 1)
        return mp.det(matrix)

    def multipliers(self):
        """Return both multipliers, the larger modulus first, after checking that their product is exp(−δ)."""
        constant, one, minus = (self.characteristic(mpf(x)) for x in (0, 1, -1))
        square, linear = (one + minus) / 2 - constant, (one - minus) / 2
        if abs(constant - square * mp.exp(-self.delta)) > RESIDUAL * max(1, abs(constant)):
            raise NotFoundError("the product of the multipliers is not exp(-delta)")
        root = mp.sqrt(linear**2 - 4 * constant * square)
        both = ((-linear + root) / (2 * square), (-linear - root) / (2 * square))
        return tuple(sorted(both, key=lambda x: (-abs(x), -mp.im(x))))

    def trace(self):
        return mp.re(mp.fsum(self.multipliers()))

    def stable(self):
        return abs(self.trace()) < 1 + mp.exp(-self.delta)

    def admissible(self):
        """Every flight stays inside the gap, to DEPTH, until it ends: a march of 4096 steps in doubles."""
        for i, (wall, t0, w0, _, t1, _) in enumerate(self.legs()):
            if wall * w0 > 0 or t1 <= t0:
                return False
            s = float(t1 - t0) * np.arange(1, 4096) / 4096
            if (abs(self.march(s, i)) > float(self.beta) + DEPTH).any():
                return False
        return True

    def march(self, s, i=0):
        """Places on a flight in doubles."""
        wall, t0, w0, *_ = list(self.legs())[i]
        delta, epsilon, t0, w0 = float(self.delta), float(self.epsilon), float(t0), float(w0)
        decay = (4 * np.pi - TWO_PI * epsilon * np.sin(TWO_PI * t0) - w0) / delta
        swing = np.cos(TWO_PI * (t0 + s)) - np.cos(TWO_PI * t0)
        return wall * float(self.beta) + decay * np.expm1(-delta * s) + epsilon * swing + 4 * np.pi * s


class Point(NamedTuple):
    """A verified point of a curve: the orbit, with phase and speed after its impact on Σ⁺, and its two multipliers."""

    delta: mpf
    epsilon: mpf
    phase: mpf
    speed: mpf
    multipliers: tuple
    cycle: Cycle


class Kind(NamedTuple):
    """Definition of a curve: impacts per period, the orbit's multiplier, and whether its flight grazes Σ⁻."""

    impacts: int
    multiplier: int | None = None
    grazes: bool = False


KINDS = {
    "SN1": Kind(1, 1),
    "SN2": Kind(2, 1),
    "PD1": Kind(2, -1),
    "PD2": Kind(2, -1),
    "PDC": Kind(1, -1),
    "G1": Kind(1, grazes=True),
    "G2": Kind(1, grazes=True),
}
POINTS = {"COD20": lambda _: -1, "COD21": lambda delta: mp.exp(-delta / 2), "COD22": lambda _: 1}


def force(t, delta, epsilon):
    angle = 2 * mp.pi * t
    return 4 * mp.pi * delta - 4 * mp.pi**2 * epsilon * mp.cos(angle) - 2 * mp.pi * delta * epsilon * mp.sin(angle)


def newton(equations, guess, digits=6, near=NEAR):
    """The solution near a guess that is rounded first."""
    start = [mpf(f"{float(x):.{digits}g}") for x in guess]
    try:
        found = list(mp.findroot(equations, start, tol=mpf(10) ** -34, maxsteps=30, verify=False))
    except (ZeroDivisionError, ValueError) as error:
        raise NotFoundError(str(error)) from None
    missed = max(abs(x) for x in equations(*found))
    if missed > RESIDUAL:
        raise NotFoundError(f"residual {mp.nstr(missed, 3)}")
    moved = max(abs(float(x) - float(y)) / (1 + abs(float(y))) for x, y in zip(found, guess, strict=True))
    if moved > near:
        raise NotFoundError(f"Newton left the guess by {moved:.2g}")
    return found


def solve(name, delta, beta, guess):
    """The verified point of a curve at this damping, near (ε, phase, speed[, phase of a graze or both at Σ⁻])."""
    cycle = _solve(KINDS[name], mpf(delta), mpf(beta), guess)
    if name in ("G1", "G2") and (cycle.trace() > 1 + mp.exp(-cycle.delta)) != (name == "G2"):
        raise NotFoundError("the other orbit grazes")
    if name == "SN2" and not is_birth(cycle):
        raise NotFoundError("two orbits end there as ε rises")
    if name == "PD1" and trace_slope(cycle) > 0:
        raise NotFoundError("stability returns there as ε rises")
    return _point(cycle)


def solve_codimension_two(name, beta, guess):
    """COD20, COD21 or COD22, where a multiplier on the grazing curve is −1, double, or 1, near (δ, ε, phase, ...)."""
    return _point(_solve(KINDS["G1"], guess[0], mpf(beta), guess[1:], POINTS[name]))


def _point(cycle):
    return Point(cycle.delta, cycle.epsilon, cycle.times[0] % 1, -cycle.velocities[0], cycle.multipliers(), cycle)


def _solve(kind, delta, beta, guess, multiplier_at=None):
    """The admissible cycle of a kind; δ is an unknown too if multiplier_at, of δ, asks for one multiplier more."""
    n = kind.impacts

    def cycle(x):
        d = x[-1] if multiplier_at else delta
        return Cycle((x[1], x[3])[:n] if n == 2 else x[1:2], (-x[2], x[4]) if n == 2 else (-x[2],), d, x[0], beta)

    def equations(*x):
        now = cycle(x)
        rows = now.closure()
        if kind.grazes:
            flight = now.flight()
            rows += [flight.position(x[3] - x[1]) + beta, flight.velocity(x[3] - x[1])]
        if kind.multiplier is not None:
            rows.append(now.characteristic(mpf(kind.multiplier)))
        if multiplier_at:
            rows.append(now.characteristic(mpf(multiplier_at(now.delta))))
        return rows

    found = newton(equations, [*guess, delta] if multiplier_at else guess)
    now = cycle(found)
    if now.epsilon <= 0 or not now.admissible():
        raise NotFoundError("the orbit is not admissible")
    if kind.grazes and not (0 < found[3] - found[1] < 1 and now.force(found[3]) > 0):
        raise NotFoundError("the flight has no minimum on the wall")
    return now


def neighbour(cycle, epsilon=None, phase=None):
    """The orbit next to this one at a given ε or a given phase at Σ⁺."""
    n = len(cycle.times)
    fixed = epsilon is None

    def moved(x):
        e, t = (x[0], phase) if fixed else (epsilon, x[0])
        return Cycle((t, *x[2:3]), (-x[1], *x[3:4]), cycle.delta, e, cycle.beta)

    start = [cycle.epsilon if fixed else cycle.times[0], -cycle.velocities[0]]
    start += [cycle.times[1], cycle.velocities[1]] if n == 2 else []
    return moved(newton(lambda *x: moved(x).closure(), start, digits=40))


def is_birth(cycle):
    """Return whether the orbits beside a fold are at higher ε."""
    return all(neighbour(cycle, phase=cycle.times[0] + h).epsilon > cycle.epsilon for h in (STEP, -STEP))


def trace_slope(cycle):
    """Sign of d trace/dε: below 0 where a flip ends stability as ε rises, above 0 where it returns."""
    return mp.sign(neighbour(cycle, epsilon=cycle.epsilon + STEP).trace() - cycle.trace())


def quiet_limit(delta):
    """(ε, phase) at which the contact force of the gear at rest first vanishes: its minimum over time is 0."""
    delta = mpf(delta)

    def slope(t, epsilon):
        return 8 * mp.pi**3 * epsilon * mp.sin(2 * mp.pi * t) - 4 * mp.pi**2 * delta * epsilon * mp.cos(2 * mp.pi * t)

    times = [k / 360 for k in range(360)]
    still = force(mpf(0), delta, mpf(0))
    pull = [float(still - force(mpf(t), delta, mpf(1))) for t in times]
    guess = float(still) / max(pull), times[int(np.argmax(pull))]
    epsilon, t = newton(lambda e, t: [force(t, delta, e), slope(t, e)], guess, near=0.01)
    if min(force(mpf(t), delta, epsilon) for t in times) < 0:
        raise NotFoundError("the force is negative elsewhere")
    return epsilon, t % 1


# Guesses, in doubles.


def family(s, delta, beta):
    """(ε, phase, speed, speed at Σ⁻) of closed cycles that reach Σ⁻ after time s.

    With ε cos 2πt₀ and ε sin 2πt₀ for ε and t₀, what the two flights miss is affine in all unknowns: it is measured.
    """

    def missed(x, y, v, u):
        cosine, sine = np.cos(TWO_PI * s), np.sin(TWO_PI * s)
        x1, y1 = x * cosine - y * sine, y * cosine + x * sine
        rows = []
        for span, gap, xa, ya, wa, xb, yb, wb in ((s, 2, x, y, -v, x1, y1, -u), (1 - s, -2, x1, y1, u, x, y, v)):
            c = (4 * np.pi - TWO_PI * ya - wa) / delta
            rows += [gap * beta + c * np.expm1(-delta * span) + xb - xa + 4 * np.pi * span]
            rows += [4 * np.pi - TWO_PI * yb - delta * c * np.exp(-delta * span) - wb]
        return np.stack(rows, -1)

    unit = np.eye(4)[:, :, None] * np.ones_like(s)
    constant = missed(*(0 * unit[0]))
    matrix = np.stack([missed(*e) - constant for e in unit], -1)
    x, y, v, u = np.linalg.solve(matrix, -constant[..., None])[..., 0].T
    return np.hypot(x, y), np.arctan2(y, x) / TWO_PI, v, u


def tangent(span, t0, w0, w1, delta, epsilon):
    """∂(t₁, velocity after the impact)/∂(t₀, w₀) of one flight, by the equations of `ContactCycle.characteristic`."""

    def acceleration(t, w):
        angle = TWO_PI * t
        return 4 * np.pi * delta - TWO_PI * epsilon * (TWO_PI * np.cos(angle) + delta * np.sin(angle)) - delta * w

    decay = np.exp(-delta * span)
    drift = (1 - decay) / delta
    a0, a1 = acceleration(t0, w0), acceleration(t0 + span, w1)
    dt = np.stack([w0 + a0 * drift, -drift]) / w1
    return np.stack([dt, -np.stack([-a0 * decay, decay]) - a1 * dt])


def family_trace(s, delta, epsilon, phase, v, u):
    down, up = tangent(s, phase, -v, -u, delta, epsilon), tangent(1 - s, phase + s, u, v, delta, epsilon)
    return np.einsum("ij...,ji...->...", up, down)


def one_flight(delta, trace=None):
    """(ε sin 2πt₀, speed, ε cos 2πt₀ where the trace is as given) of cycles without impact on Σ⁻.

    ε cos 2πt₀ drops out of their closure, which is affine in the other two; the trace is affine in it.
    """
    decay = np.exp(-delta)
    c = 4 * np.pi / (1 - decay)  # the flight returns to its wall after time 1
    sine, v = (4 * np.pi - delta * c * (1 + decay) / 2) / TWO_PI, delta * c * (1 - decay) / 2
    if trace is None:
        return sine, v
    at = []
    for cosine in (0.0, 1.0):
        matrix = tangent(1.0, np.arctan2(sine, cosine) / TWO_PI, -v, v, delta, np.hypot(cosine, sine))
        at.append(matrix[0, 0] + matrix[1, 1])
    return sine, v, (trace - at[0]) / (at[1] - at[0])


def clearance(cosine, sine, delta, beta, steps=500):
    """Least height above Σ⁻ of such a cycle, and when after the impact, by the parabola through its lowest samples."""
    s = np.arange(1, steps) / steps
    cosine, sine, delta = (np.asarray(x)[..., None] for x in (cosine, sine, delta))
    swing = cosine * (np.cos(TWO_PI * s) - 1) - sine * np.sin(TWO_PI * s)
    place = 4 * np.pi / -np.expm1(-delta) * np.expm1(-delta * s) + swing + 4 * np.pi * s + 2 * beta
    lowest = np.clip(place.argmin(axis=-1), 1, steps - 3)
    before, at, after = (np.take_along_axis(place, lowest[..., None] + k, -1)[..., 0] for k in (-1, 0, 1))
    offset = np.clip((before - after) / (2 * (before - 2 * at + after)), -1, 1)
    return at - (before - after) * offset / 4, s[lowest] + offset / steps


def crossing(x, value, i):
    return float(x[i] + (x[i + 1] - x[i]) * value[i] / (value[i] - value[i + 1]))


def scan(delta, beta, points=3000):
    """Times to Σ⁻, denser about the pole of the family at s = 1/2 and about its grazes, where curves come close."""
    gap = np.geomspace(1e-6, 0.5 * (1 - 1e-6), points)
    s = np.concatenate([(0.5 - gap)[::-1], 0.5 + gap])
    u = family(s, delta, beta)[3]
    near = np.geomspace(1e-8, 1e-2, 200)
    grazes = [crossing(s, u, i) for i in np.flatnonzero((u[:-1] * u[1:] < 0) & (np.diff(s) < 1e-2)) if s[i] > 0.5]
    return np.sort(np.concatenate([s, *(g + side * near for g in grazes for side in (-1, 1))]))


def family_crossings(delta, beta, multiplier, highest):
    """(time to Σ⁻, guess) of the members with a multiplier of 1 or −1, by that time."""
    s = scan(delta, beta)
    epsilon, phase, v, u = family(s, delta, beta)
    value = family_trace(s, delta, epsilon, phase, v, u) - multiplier * (1 + np.exp(-delta))
    ok = (epsilon < highest) & (v > 0) & (u > 0)
    for i in np.flatnonzero(ok[:-1] & ok[1:] & (value[:-1] * value[1:] < 0) & (np.diff(s) < 1e-2)):
        root = crossing(s, value, i)
        e, t, w, low = (float(x[0]) for x in family(np.array([root]), delta, beta))
        yield root, (e, t, w, t + root, low)


def guesses(name, delta, beta, highest=1.0):
    """Guesses for all points of a curve at this damping, whether admissible or not."""
    delta, beta = float(delta), float(beta)
    kind = KINDS[name]
    if kind.impacts == 2:
        found = [x for x in family_crossings(delta, beta, kind.multiplier, highest) if x[0] > 0.5]
        if kind.multiplier == -1:  # PD1 is the first after SN2 on the way of D
            births = [x[0] for x in family_crossings(delta, beta, 1, highest) if x[0] > 0.5]
            first = [x for x in found if births and x[0] > births[0]][:1]
            found = first if name == "PD1" else [x for x in found if x not in first]
        yield from (guess for _, guess in found)
        return
    if not kind.grazes:
        sine, v, cosine = one_flight(delta, kind.multiplier * (1 + np.exp(-delta)))
        yield np.hypot(cosine, sine), np.arctan2(sine, cosine) / TWO_PI, v
        return
    sine, v = one_flight(delta)
    cosine = np.linspace(-highest, highest, 801)
    height, _ = clearance(cosine, sine, delta, beta)
    for i in np.flatnonzero(height[:-1] * height[1:] < 0):
        root = crossing(cosine, height, i)
        t = np.arctan2(sine, root) / TWO_PI
        yield np.hypot(root, sine), t, v, t + float(clearance(root, sine, delta, beta)[1])


def points_of_codimension_two(name, beta, lowest=0.05, highest=2.5):
    """All verified points of a name, by δ; their orbit has its multiplier and grazes."""
    delta = np.geomspace(lowest, highest, 1200)
    multiplier = {"COD20": -1 + 0 * delta, "COD21": np.exp(-delta / 2), "COD22": 1 + 0 * delta}[name]
    sine, v, cosine = one_flight(delta, multiplier + np.exp(-delta) / multiplier)
    height, _ = clearance(cosine, sine, delta, float(beta))
    found = []
    for i in np.flatnonzero(height[:-1] * height[1:] < 0):
        d = crossing(delta, height, i)
        x, y, w = (np.interp(d, delta, z) for z in (cosine, sine, v))
        t = np.arctan2(y, x) / TWO_PI
        try:
            _, when = clearance(x, y, d, float(beta))
            found.append(solve_codimension_two(name, beta, (d, np.hypot(x, y), t, w, t + float(when))))
        except NotFoundError:
            continue
    return found


def points(name, delta, beta, highest=1.0):
    """All verified points of a curve at this damping with ε below a limit, by ε."""
    found = []
    for guess in guesses(name, delta, beta, highest):
        try:
            point = solve(name, delta, beta, guess)
        except NotFoundError:
            continue
        if point.epsilon <= highest and all(abs(point.epsilon - other.epsilon) > 1e-12 for other in found):
            found.append(point)
    return sorted(found, key=lambda p: p.epsilon)


def end_of_folds(beta):
    """The point of G1 in which SN2 and PD1 end: (δ, ε) and the multipliers of the grazing C.

    As the speed u of their orbit at Σ⁻ goes to 0, the trace stays finite only where its part in 1/u vanishes: there the
    characteristic determinant of the grazing orbit, the impact at speed 0 counted, is 0 for every multiplier, and a
    change of velocity at the graze has no effect on the place one period later.
    """
    beta = mpf(beta)

    def cycle(e, t0, v, t1, d):
        return Cycle((t0, t1), (-v, mpf(0)), d, e, beta)

    def equations(*x):
        now = cycle(*x)
        return [*now.closure(), now.characteristic(mpf(1))]

    first, last = (points_of_codimension_two(name, beta)[0].delta for name in ("COD21", "COD22"))
    value, at = [], []
    for share in np.linspace(0, 0.4, 4):
        d = first + (last - first) * mpf(share)
        guess = max((g for g in guesses("G1", d, beta) if np.cos(TWO_PI * g[1]) > 0), key=lambda g: -g[0])
        orbit = _solve(KINDS["G1"], d, beta, guess)
        s = mp.findroot(orbit.flight().velocity, guess[3] - guess[1])
        at.append((orbit.epsilon, orbit.times[0], -orbit.velocities[0], orbit.times[0] + s, d))
        value.append(float(cycle(*at[-1]).characteristic(mpf(1))))
    i = next(i for i in range(3) if value[i] * value[i + 1] < 0)
    share = value[i] / (value[i] - value[i + 1])
    found = newton(equations, [x + share * (y - x) for x, y in zip(at[i], at[i + 1], strict=True)])
    return _point(Cycle([found[1]], [-found[2]], found[4], found[0], beta))


def orbits(delta, epsilon, beta):
    """All admissible cycles of period 1 at one place of the plane, as (letter, cycle, time to Σ⁻ or 0), in doubles.

    A has cos 2πt₀ < 0, C the other sign; on B, ε falls with the time to Σ⁻, and on D it rises.
    """
    sine, v = one_flight(delta)
    found = []
    if epsilon >= abs(sine):
        for letter, cosine in zip("AC", np.sqrt(epsilon**2 - sine**2) * np.array([-1, 1]), strict=True):
            found.append((letter, Cycle([np.arctan2(sine, cosine) / TWO_PI], [-v], delta, epsilon, beta), 0.0))
    s = scan(delta, beta)
    folds = [x[0] for x in family_crossings(delta, beta, 1, 10.0)]
    s = np.sort(np.concatenate([s, folds]))
    e = family(s, delta, beta)[0] - epsilon
    lo = np.flatnonzero((e[:-1] * e[1:] < 0) & (np.diff(s) < 1e-2) & ~((s[:-1] < 0.5) & (s[1:] > 0.5)))
    left, right, sign = s[lo], s[lo + 1], np.sign(e[lo])
    for _ in range(55):
        middle = (left + right) / 2
        same = np.sign(family(middle, delta, beta)[0] - epsilon) == sign
        left, right = np.where(same, middle, left), np.where(same, right, middle)
    _, phase, v, u = family(left, delta, beta)
    for x, t, w, low, before in zip(left, phase, v, u, sign, strict=True):
        if w > 0 and low > 0:
            cycle = Cycle([t, t + x], [-w, low], delta, epsilon, beta)
            found.append(("D" if before < 0 else "B", cycle, float(x)))
    return [x for x in found if x[1].admissible()]


def double_trace(cycle):
    """Trace in doubles, for cycles known in doubles only."""
    delta, epsilon = float(cycle.delta), float(cycle.epsilon)
    t, w = [float(x) for x in cycle.times], [float(x) for x in cycle.velocities]
    if len(t) == 1:
        return float(np.trace(tangent(1.0, t[0], w[0], -w[0], delta, epsilon)))
    return float(family_trace(t[1] - t[0], delta, epsilon, t[0], -w[0], w[1]))


def region(delta, epsilon, beta):
    """Region by definition (0: another combination), and the letters of its orbits with D's stability."""
    found = sorted(orbits(delta, epsilon, beta), key=lambda x: -x[2])
    letters = "".join(sorted({x[0] for x in found}))
    d = next((c for letter, c, _ in found if letter == "D"), None)
    stable = d is not None and bool(abs(double_trace(d)) < 1 + np.exp(-delta))
    number = {"": 1, "AC": 2, "AD": 5, "ABCD": 3 if stable else 4}.get(letters, 0)
    return number, letters, stable


# The same, kept in tests/reference.


class Known(NamedTuple):
    """A point of a curve without its orbit."""

    delta: mpf
    epsilon: mpf
    phase: mpf
    speed: mpf
    multipliers: tuple


def _numbers(point):
    return list(point[:4]), list(point.multipliers)


def _known(numbers):
    return Known(*numbers[0], tuple(numbers[1]))


@stored
def curve_points(name, delta, beta, highest):
    return [_numbers(point) for point in points(name, delta, beta, highest)]


@stored
def curve_point_near(name, delta, beta, epsilon, highest):
    guess = min(guesses(name, delta, beta, highest), key=lambda x: abs(x[0] - epsilon))
    return _numbers(solve(name, delta, beta, guess))


@stored
def codimension_two(name, beta):
    found = [end_of_folds(beta)] if name == "COD23" else points_of_codimension_two(name, beta)
    return [_numbers(point) for point in found]


@stored
def regions_beside(name, delta, beta, epsilon):
    """Regions 1e-6 below and above a curve, None where another curve is within reach."""
    reach = 1e-5
    for other in KINDS:
        found = points(other, delta, beta, epsilon + 2 * reach) if other != name else []
        if any(abs(float(p.epsilon) - epsilon) < reach for p in found):
            return None
    return [region(delta, epsilon + side, beta) for side in (-1e-6, 1e-6)]


def known_points(name, delta, beta, highest=1.0):
    """`points`, without orbits."""
    return [_known(point) for point in curve_points(name, delta, beta, highest)]


def known_point_near(name, delta, beta, epsilon, highest):
    """The point of a curve at this damping whose ε is nearest."""
    return _known(curve_point_near(name, delta, beta, epsilon, highest))


def known_codimension_two(name, beta):
    """The only point of its name."""
    (point,) = codimension_two(name, beta)
    return _known(point)
