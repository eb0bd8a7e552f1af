"""The model in 40 digits, written from the equations alone: no code or formula is shared with the library."""

from mpmath import mp, mpf

mp.dps = 40


class Flight:
    """Free flight (paper 3.1, 3.2) from Φ = wall·β at phase t0 with velocity w0."""

    def __init__(self, wall, t0, w0, delta, epsilon, beta):
        self.t0, self.delta, self.epsilon, self.beta = mpf(t0), mpf(delta), mpf(epsilon), mpf(beta)
        self.start = wall * self.beta
        self.c = (4 * mp.pi - 2 * mp.pi * self.epsilon * mp.sin(2 * mp.pi * self.t0) - mpf(w0)) / self.delta

    def position(self, s):
        swing = mp.cos(2 * mp.pi * (self.t0 + s)) - mp.cos(2 * mp.pi * self.t0)
        return self.start + self.c * (mp.exp(-self.delta * s) - 1) + self.epsilon * swing + 4 * mp.pi * s

    def velocity(self, s):
        forced = 4 * mp.pi - 2 * mp.pi * self.epsilon * mp.sin(2 * mp.pi * (self.t0 + s))
        return forced - self.delta * self.c * mp.exp(-self.delta * s)

    def first_impact(self, longest=0.004):
        """(time, wall, velocity) by steps of 4 % of the time flown, 0.004 at most; turning points are refined."""
        lo = mpf(10) ** -14
        while True:
            hi = lo + min(lo / 25, longest)
            turns = self.velocity(lo) * self.velocity(hi) < 0
            for end in [_root(self.velocity, lo, hi), hi] if turns else [hi]:
                for wall in (1, -1):
                    if wall * self.position(end) > self.beta:
                        t = _root(lambda s, wall=wall: self.position(s) - wall * self.beta, lo, end)
                        return t, wall, self.velocity(t)
                lo = end


def _root(f, lo, hi):
    """A root of f in a bracket, to the working precision."""
    return mp.findroot(f, (lo, hi), solver="anderson", tol=mpf(10) ** -60, maxsteps=200, verify=False)
