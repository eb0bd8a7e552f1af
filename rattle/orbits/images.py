"""Map states by powers of Π or Π⁻¹, with phases that are not reduced to [0, 1), and count impacts on Σ⁻ (compiled)."""

import numpy as np

from rattle.flight.first_impact import OK
from rattle.numerics.compile import kernel
from rattle.orbits.return_map import inverse_step, step


@kernel
def apply_unfolded_map_power(tau, v, steps, turns, backwards, point):
    """Apply Π^steps, or Π^−steps if `backwards`, to flat arrays of n states at one parameter point.

    τ is not folded into [0, 1), so that neighbours stay neighbours. From τ after all steps, `turns` forcing periods are
    subtracted; if `backwards`, they are added.

    Returns
    -------
    tuple
        (ok, τ, v, word, number of impacts on Σ⁻), each (n,). ok: whether the image exists. word: a hash of the numbers
        of impacts on Σ⁻ in the steps, in order.
    """
    n = tau.size
    ok, out_tau, out_v = np.ones(n, np.bool_), np.empty(n), np.empty(n)
    word, bounces = np.zeros(n, np.int64), np.zeros(n, np.int64)
    for i in range(n):
        t, w, at, code = tau[i], v[i], tau[i], np.int64(0)
        for _ in range(steps):
            if backwards:
                status, t, w, time, number = inverse_step(t, w, point)
                at -= time
            else:
                status, t, w, time, number = step(t, w, point)
                at += time
            code = code * 1000003 + number + 1
            bounces[i] += number
            if status != OK:
                ok[i] = False
                break
        out_tau[i], out_v[i], word[i] = at + turns if backwards else at - turns, w, code
    return ok, out_tau, out_v, word, bounces
