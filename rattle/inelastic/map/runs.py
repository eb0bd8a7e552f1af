"""Count the impacts of a motion with contact phases as its label P(m, n₊, n₋) counts them (compiled)."""

from rattle.flight.first_impact import OK
from rattle.flight.law import wrap_phase_difference
from rattle.inelastic.map.impact_map import step
from rattle.numerics.compile import kernel


@kernel
def count_contacts_and_merged_impacts(tau, v, n, point):
    """Count the contact phases of a motion that repeats after n returns, and the impacts that its label leaves out.

    In the label P(m, n₊, n₋) a run of impacts on Σ⁺ that ends in contact counts as one impact. The run begins after an
    impact on Σ⁻ or after the previous contact phase.

    Returns
    -------
    contacts, merged : int
        Number of contact phases on both walls, and number of impacts on Σ⁺ that the label leaves out.
    """
    contacts, merged, run, counted = 0, 0, 0, -1
    for _ in range(2 * n):
        status, tau, v, _time, below, on_plus, on_minus = step(tau, v, point)
        if status != OK:
            break
        run += 1
        if counted >= 0:
            contacts += on_plus + on_minus
            counted += 1
        if on_plus > 0:
            if counted >= 0:
                merged += run - 1
            run = 0
            counted = max(counted, 0)
        elif below > 0:
            run = 0
        if counted == n:
            return contacts, merged
    # no contact phase on Σ⁺ was found: the label leaves out no impact on Σ⁺, and contact phases can be on Σ⁻ only
    contacts = 0
    for _ in range(n):
        status, tau, v, _time, below, on_plus, on_minus = step(tau, v, point)
        contacts += on_minus
    return contacts, 0


@kernel
def count_returns_of_contact_motion(tau, v, most, tolerance, point):
    """Return the number of returns to Σ⁺ after which a motion with a contact phase is back at its first state (τ, v).

    tolerance: the largest difference from the first state, in τ and, relative to v, in the speed.

    Returns
    -------
    int
        Number of returns; 0 if the motion does not come back within `most` returns, or has no contact phase.
    """
    t, w, contacts = tau, v, 0
    for k in range(1, most + 1):
        status, t, w, _time, _below, on_plus, on_minus = step(t, w, point)
        if status != OK:
            return 0
        contacts += on_plus + on_minus
        if contacts > 0 and abs(wrap_phase_difference(t - tau)) < tolerance and abs(w - v) < tolerance * v:
            return k
    return 0
