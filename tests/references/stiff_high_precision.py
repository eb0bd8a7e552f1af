"""The stiff gear by other means: contact in 60 digits from complex roots, and whole motions by scipy's integrator."""

import numpy as np
from mpmath import mp, mpf
from scipy.integrate import solve_ivp

DIGITS = 60


class Contact:
    """x'' + δx' + 2κx = ±g(t): its depth and velocity by characteristic roots, all in complex numbers."""

    def __init__(self, wall, t0, x0, w0, delta, epsilon, kappa):
        with mp.workdps(DIGITS):
            self.t0, d, k = mpf(float(t0)), mpf(float(delta)), mpf(kappa)
            self.mean = wall * 4 * mp.pi * d / (2 * k)
            i_omega = 2j * mp.pi
            size = wall * 2 * mp.pi * mpf(float(epsilon))
            # −(2π cos + δ sin) = Re((−2π + iδ) e^(iωt))
            self.swing = size * mp.mpc(-2 * mp.pi, d) / (i_omega**2 + d * i_omega + 2 * k)
            root = mp.sqrt(mp.mpc(d * d / 4 - 2 * k))
            self.roots = (-d / 2 + root, -d / 2 - root)
            y, w = mpf(float(x0)) - self._forced(0)[0], mpf(float(w0)) - self._forced(0)[1]
            r0, r1 = self.roots
            self.parts = ((w - r1 * y) / (r0 - r1), (r0 * y - w) / (r0 - r1))

    def _forced(self, s):
        turn = self.swing * mp.expjpi(2 * (self.t0 + s))
        return self.mean + turn.real, (2j * mp.pi * turn).real

    def at(self, s):
        """Depth and velocity after s."""
        with mp.workdps(DIGITS):
            s = mpf(float(s))
            x, v = self._forced(s)
            for part, root in zip(self.parts, self.roots, strict=True):
                free = part * mp.exp(root * s)
                x, v = x + free.real, v + (root * free).real
            return x, v


def integrated(t0, position, velocity, duration, delta, epsilon, beta, kappa):
    """(Φ, Φ', contacts with Σ⁺, with Σ⁻) after a duration: DOP853 from wall to wall, found as events."""

    def force(t):
        return delta * (4 * np.pi - 2 * np.pi * epsilon * np.sin(2 * np.pi * t)) - 4 * np.pi**2 * epsilon * np.cos(
            2 * np.pi * t
        )

    def meets(sign):
        return lambda _, y: sign * y[0] - beta

    events = [meets(1), meets(-1)]
    for event in events:
        event.terminal = True
    time, state, counts = t0, [position, velocity], [0, 0]
    wall = 0 if abs(position) < beta else int(np.sign(position))
    while True:

        def field(t, y, wall=wall):
            return [y[1], force(t) - delta * y[1] - 2 * kappa * (y[0] - wall * beta if wall else 0.0)]

        for event in events:
            event.direction = 1 if wall == 0 else -1
        # an event is seen only where its sign differs between steps: short steps, lest a grazing contact is missed
        longest = 0.01 if wall == 0 else 0.1 / np.sqrt(2 * kappa + 100)
        run = solve_ivp(
            field, (time, t0 + duration), state, "DOP853", events=events, rtol=1e-12, atol=1e-14, max_step=longest
        )
        if run.status == 0:
            return run.y[0, -1], run.y[1, -1], *counts
        hit = 0 if run.t_events[0].size else 1
        time, state = run.t_events[hit][0], run.y_events[hit][0]
        state[0] = (1, -1)[hit] * beta
        if wall == 0:
            counts[hit] += 1
            wall = (1, -1)[hit]
        else:
            wall = 0
