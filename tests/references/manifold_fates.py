"""Find where states beside a manifold end, for either model."""

import numpy as np

AT_REST = 0.05  # impacting motions that come to rest lose their speed, stiff ones make no more returns


def fates_beside(gear, found, n):
    """Fates (2, 40) after n returns of states 1e-5 to the left and to the right of a manifold: words."""
    pick = np.linspace(5, found.tau.size - 5, 40).astype(int)
    along = np.stack([found.tau[pick + 1] - found.tau[pick - 1], found.v[pick + 1] - found.v[pick - 1]])
    across = 1e-5 * np.stack([-along[1], along[0]]) / np.hypot(*along)
    fates = []
    for sign in (1, -1):
        end = gear.iterate(found.tau[pick] + sign * across[0], found.v[pick] + sign * across[1], n)
        once = gear.iterate(end.tau, end.v, 1)
        quiet = (end.n_plus < n) | (end.v < AT_REST)
        still = np.hypot(once.tau - end.tau, once.v - end.v) < 1e-6
        fates.append(np.where(quiet, "quiet", np.where(still, "P(1,1,0)", "other")))
    return np.array(fates)
