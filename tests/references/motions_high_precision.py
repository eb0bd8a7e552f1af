"""Any periodic motion and its events in 40 digits, from the differential equation and the impact law alone.

A motion is a cycle of impacts over m forcing periods on given walls, as in `curves_high_precision`; at an event ε is
unknown and there is one condition more: a multiplier of 1 or −1, or an impact of speed 0.
"""

import curves_high_precision as exact
from mpmath import mp, mpf
from stored import stored


class Motion(exact.Cycle):
    """A closed motion over m forcing periods: times and velocities after its impacts on these walls."""

    def __init__(self, times, velocities, walls, m, delta, epsilon, beta):
        super().__init__(times, velocities, delta, epsilon, beta)
        self.walls, self.m = tuple(walls), m

    def legs(self):
        n = len(self.times)
        for i in range(n):
            j = (i + 1) % n
            end = self.times[j] + (self.m if j == 0 else 0)
            yield self.walls[i], self.times[i], self.velocities[i], self.walls[j], end, -self.velocities[j]

    def multipliers(self):
        """Return both multipliers, the larger modulus first, after checking that their product is e^(−δm)."""
        constant, one, minus = (self.characteristic(mpf(x)) for x in (0, 1, -1))
        square, linear = (one + minus) / 2 - constant, (one - minus) / 2
        if abs(constant / square - mp.exp(-self.delta * self.m)) > mpf(10) ** -25:
            raise exact.NotFoundError("the product of the multipliers is not exp(-delta m)")
        root = mp.sqrt(linear**2 - 4 * constant * square)
        return tuple(sorted(((s * root - linear) / (2 * square) for s in (1, -1)), key=lambda x: -abs(x)))


def velocities(motion):
    """Velocities after the impacts in doubles, by the place that each flight has to reach: it is affine in them."""
    found = []
    for wall, t0, _, following, t1, _ in motion.legs():
        at = []
        for w in (0, 1):
            flight = exact.Flight(wall, t0, w, motion.delta, motion.epsilon, motion.beta)
            at.append(flight.position(t1 - t0) - following * motion.beta)
        found.append(float(-at[0] / (at[1] - at[0])))
    return found


def event(times, walls, m, delta, epsilon, beta, multiplier=None, grazed=None, digits=6):
    """The motion with this multiplier, or with speed 0 at impact number `grazed`, near times and ε rounded so far."""
    n, delta, beta = len(walls), mpf(delta), mpf(beta)
    rough = Motion([mpf(float(t)) for t in times], [mpf(0)] * n, walls, m, delta, mpf(float(epsilon)), beta)

    def motion(x):
        return Motion(x[1 : n + 1], x[n + 1 :], walls, m, delta, x[0], beta)

    def equations(*x):
        now = motion(x)
        last = now.velocities[grazed] if multiplier is None else now.characteristic(mpf(multiplier))
        return [*now.closure(), last]

    return motion(exact.newton(equations, [epsilon, *times, *velocities(rough)], digits))


@stored
def event_values(times, walls, m, delta, epsilon, beta, multiplier, grazed):
    found = event(times, walls, m, delta, epsilon, beta, multiplier, grazed)
    return [found.epsilon, found.times, [] if multiplier is None else list(found.multipliers())]


def known_event(times, walls, m, delta, epsilon, beta, multiplier=None, grazed=None):
    """ε, times and, if one is asked for, multipliers of `event` near times and ε of six digits, kept in
    tests/reference.
    """
    short = [round(float(t), 6) for t in times]
    epsilon = float(f"{float(epsilon):.6g}")
    return event_values(short, list(walls), m, delta, epsilon, beta, multiplier, grazed)


@stored
def motion_values(times, walls, m, delta, epsilon, beta):
    n = len(walls)
    rough = Motion([mpf(t) for t in times], [mpf(0)] * n, walls, m, mpf(delta), mpf(epsilon), mpf(beta))

    def motion(x):
        return Motion(x[:n], x[n:], walls, m, rough.delta, rough.epsilon, rough.beta)

    found = motion(exact.newton(lambda *x: motion(x).closure(), [*times, *velocities(rough)], 7))
    return [found.times, found.velocities, list(found.multipliers())]


def known_motion(orbit):
    """Times, velocities after impacts and multipliers of a motion at these very doubles, near times of seven digits,
    kept in tests/reference.
    """
    times = [round(float(t), 7) for t in orbit.times]
    return motion_values(times, list(orbit.walls), orbit.m, orbit.delta, orbit.epsilon, orbit.beta)
