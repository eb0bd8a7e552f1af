"""Images of states under Π or Π⁻¹ with phases that are not folded, and the impacts on Σ⁻ step by step (compiled)."""

from rattle.flight.first_impact import OK
from rattle.impacting.map.impact_map import inverse_impact
from rattle.numerics.compile import kernel


@kernel
def lowest_preimages(tau, v, steps, ceiling, delta, epsilon, beta):
    """Of the preimages Π⁻ᵏ, k from 0 to steps, of each of flat arrays of states the slowest: (τ, v). Each is followed
    no further than its first preimage above `ceiling`; parameters are arrays too.
    """
    out_tau, out_v = tau.copy(), v.copy()
    for i in range(tau.size):
        t, w = tau[i], v[i]
        for _ in range(steps):
            status, t, w, _, _ = inverse_impact(t, w, delta[i], epsilon[i], beta[i])
            if status != OK or w > ceiling:
                break
            if w < out_v[i]:
                out_tau[i], out_v[i] = t, w
    return out_tau, out_v
