"""Find the boundary crisis at one damping: the ε from which W^u(A) escapes, the contact there, and whether chaos ends.

W^u(A), the unstable manifold of the saddle A, escapes if a part of it becomes quiet. A contact is a point at which it
touches W^s(A), the stable manifold.
"""

from contextlib import suppress

import numpy as np

from rattle.errors import RattleError, require_number
from rattle.impacting.bifurcations.codimension_two import codimension_two
from rattle.impacting.crisis.contact import Crisis, saddle_manifolds_at, solve_manifold_contact
from rattle.impacting.crisis.escape import (
    SAMPLES,
    FollowedManifold,
    flag_epsilon_with_escaping_part,
    is_chaotic_above_crisis,
    is_chaotic_below_crisis,
    saddle_at,
)
from rattle.impacting.orbits.limits import quiet_limit, sn1_formula
from rattle.impacting.orbits.period_one import period_one
from rattle.orbits.saddles import Array

STEP = 0.04  # relative step in ε − SN1, where SN1 is the ε of the curve SN1 at the damping
# the first ε − SN1 that is tried is LOWEST · SN1 · x², where x is the distance in δ from COD22 relative to δ of COD22;
# x² counts as at least SMALLEST and at most 0.02
LOWEST, SMALLEST = 0.5, 2e-5
# last ε − SN1 that is tried, relative to SN1; below the damping WEAK the search ends at the quiet limit, far above SN1
HIGHEST = 2.0
# damping below which the search ends at the quiet limit; damping below which the search is refused
WEAK, WEAKEST = 0.3, 0.1
HALVINGS = 6  # number of bisections of the step in ε − SN1 within which W^u(A) begins to escape
# Numbers of samples per unit of ln s, where s is the position on W^u(A). BISECTION_DENSITY is used for the bisection of
# the ε at which W^u(A) begins to escape. PIECE_DENSITY is used for the search of the piece that escapes first, and for
# the check that no piece escapes below the contact of W^u(A) with W^s(A).
BISECTION_DENSITY, PIECE_DENSITY = 2000, 40000
MARGIN = 1e-4  # distance below the crisis, relative to ε − SN1, at which no other piece of W^u(A) may escape
MOST_PIECES = 6  # largest number of contacts that are tried, each at a smaller ε than the previous one
MOST_RUNS = 4  # most runs of escaping samples whose contacts are tried in turn
# an escaping orbit is followed for at most MOST_STEPS + 20/ln λ impacts on Σ⁺; λ is the unstable multiplier of A
MOST_STEPS = 400
# an orbit is back at A if its distance from W^s(A) is below this share of its largest distance from A so far; an orbit
# counts as quiet if its speed is below this share of the speed of A
NEAR, QUIET_SPEED_SHARE = 0.3, 0.5
MOST_WIDENINGS_OF_WINDOW = 12  # most doublings of the width of a window in s


def delta_of_cod22(beta: float) -> float:
    """Return δ of COD22, where the crisis curve ends. Raises RattleError if COD22 does not exist at this beta."""
    for point in codimension_two(beta):
        if point.name == "COD22":
            return point.delta
    raise RattleError(f"COD22, where the curve of crises ends, does not exist at beta = {beta}: choose another beta")


def _distances_above_sn1_to_try(delta: float, beta: float) -> Array:
    """Return the values of ε − SN1 to try, rising by 4 % each, at which A exists.

    They end where ε reaches the quiet limit or, from δ = 0.3 on, 3 SN1 if this is less.

    Returns
    -------
    Array
        The values.

    Raises
    ------
    RattleError
        If A is born at or above the quiet limit, or COD22 does not exist at this half-backlash.
    """
    floor, top = float(sn1_formula(delta)), float(quiet_limit(delta))
    first = LOWEST * floor * min(0.02, max(SMALLEST, (1.0 - delta / delta_of_cod22(beta)) ** 2))
    last = top * (1.0 - 1e-9) - floor
    if delta >= WEAK:
        last = min(last, HIGHEST * floor)
    if last <= first:
        raise RattleError(
            f"at delta = {delta} the saddle A exists only for epsilon close to the quiet limit or above it, where no "
            "quiet motion exists: choose another delta"
        )
    gaps = first * np.exp(STEP * np.arange(int(np.log(last / first) / STEP) + 1))
    return np.asarray(gaps[period_one(delta, floor + gaps, beta).exists[0]], np.float64)


def _follow_unstable_manifold(delta: float, beta: float, gap: float, density: int) -> FollowedManifold:
    """Follow W^u(A) at ε = SN1 + gap, with at least `density` samples per unit of ln s, s the position on W^u(A).

    Returns
    -------
    FollowedManifold
        The samples, followed until they become quiet, for at most `impacts_until_quiet_at_first_return` impacts.

    Raises
    ------
    RattleError
        If the point is not `Saddles.is_decidable_at_points`.
    """
    a = saddle_at(delta, float(sn1_formula(delta)) + gap, beta)
    return FollowedManifold(a, int(SAMPLES + density * np.log(a.multiplier[0])), a.impacts_until_quiet_at_first_return)


def has_escaping_piece(delta: float, beta: float, gap: float, density: int) -> bool:
    """Return whether a piece of W^u(A) becomes quiet at ε = SN1 + gap.

    density: the least number of samples per unit of ln s, s the position on W^u(A).

    Returns
    -------
    bool
        False also if the piece lies between two neighbouring samples.
    """
    return bool(_follow_unstable_manifold(delta, beta, gap, density).quiet_sample_flags.any())


def _narrow_escape_range(delta: float, beta: float, low: float, high: float) -> tuple[float, float]:
    """Narrow the range (low, high) of ε − SN1 in which W^u(A) begins to escape, by bisection.

    At the upper end of the range a sample of W^u(A) becomes quiet, at the lower end no sample does.

    Returns
    -------
    tuple[float, float]
        The ends of the narrower range.
    """
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (low, middle) if has_escaping_piece(delta, beta, middle, BISECTION_DENSITY) else (middle, high)
    return low, high


def _find_runs_of_escaping_samples(delta: float, beta: float, gap: float) -> list[Array]:
    """Return the runs of neighbouring samples of W^u(A) that become quiet at ε = SN1 + gap, the longest run first.

    A run is an array of positions s in a fundamental domain. It includes one more sample on either side, which does not
    become quiet.

    Returns
    -------
    list[Array]
        Rising positions s of each run.

    Raises
    ------
    RattleError
        If no sample becomes quiet.
    """
    found = _follow_unstable_manifold(delta, beta, gap, PIECE_DENSITY)
    s, gone = found.positions[0], found.quiet_sample_flags[0]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], gone, [False]]).astype(int))).reshape(-1, 2)
    if not edges.size:
        raise RattleError(
            f"no sample of W^u(A) becomes quiet at epsilon = {sn1_formula(delta) + gap}, so no point is found at which "
            "W^u(A) touches W^s(A)"
        )
    runs = sorted(edges, key=lambda ends: ends[0] - ends[1])
    return [np.asarray(s[max(first - 1, 0) : last + 1], np.float64) for first, last in runs]


def _count_returns_of_orbit(delta: float, beta: float, gap: float, s: float) -> tuple[int, list[int]]:
    """Follow the orbit of the point W(s) of W^u(A), at ε = SN1 + gap, and count its impacts on Σ⁺.

    The orbit is followed until it counts as quiet, has no next impact, or has made the largest number of impacts.

    Returns
    -------
    tuple[int, list[int]]
        (met, entries). met: the number of impacts on Σ⁺ before the orbit first meets Σ⁻, less 1 but at least 0; −1 if
        the orbit never meets Σ⁻. entries: later the orbit may come back close to W^s(A) near A, several times; for
        each of these times the number of impacts on Σ⁺ since impact number `met`.
    """
    here = saddle_manifolds_at(delta, float(sn1_formula(delta)) + gap, beta)
    states, met, entries, inside, farthest = here.unstable_manifold.image(np.array([s]), 0)[1], -1, [], True, 0.0
    for j in range(MOST_STEPS + int(20.0 / np.log(here.unstable_manifold.multiplier))):
        ok, states, _, bounces = here.unstable_manifold.map(states, 1)
        if not ok.all():
            break
        if met < 0 and bounces[0] > 0:
            # the orbit makes j impacts on Σ⁺ before it meets Σ⁻, but an orbit on the other side of a nearby corner of
            # W^u(A) may make only j − 1
            met = max(j - 1, 0)
        height = float(here.signed_distances_from_stable_manifold(states)[0][0])
        farthest = max(farthest, float(np.hypot(*(states - here.saddle_state))[0]))
        before, inside = inside, abs(height) < NEAR * farthest
        if met >= 0 and inside and not before:
            entries.append(j + 1 - met)
        if states[1, 0] < QUIET_SPEED_SHARE * here.saddle.v:
            break
    return met, entries


def find_manifold_contact_near(delta: float, beta: float, low: float, high: float) -> Crisis:
    """Return the contact of a piece of W^u(A) that escapes at ε = SN1 + high but not at ε = SN1 + low.

    If there are several such pieces, the longest one for which a contact is found is taken.

    Returns
    -------
    Crisis
        The contact, with ε near the range from SN1 + low to SN1 + high.
    """
    *runs, last = _find_runs_of_escaping_samples(delta, beta, high)[:MOST_RUNS]
    for run in runs:
        with suppress(RattleError):
            return _contact_of_escaping_samples(delta, beta, low, high, run)
    return _contact_of_escaping_samples(delta, beta, low, high, last)


def _contact_of_escaping_samples(delta: float, beta: float, low: float, high: float, run: Array) -> Crisis:
    """Return the contact with W^s(A) of a piece of W^u(A): the piece that a run of escaping samples covers.

    The orbit in the middle of the run comes back to A one or more times. Each of these returns may give a contact; the
    contact with the least ε is returned.

    Returns
    -------
    Crisis
        The contact.

    Raises
    ------
    RattleError
        If the orbit does not come back to A, or no contact is found.
    """
    met, entries = _count_returns_of_orbit(delta, beta, high, float(run[run.size // 2]))
    if not entries:
        raise RattleError(
            f"no point is found at which W^u(A) touches W^s(A) near epsilon = {sn1_formula(delta) + high}: the orbit "
            "on W^u(A) that becomes quiet does not return to A"
        )
    here = saddle_manifolds_at(delta, float(sn1_formula(delta)) + high, beta)
    run = run * here.unstable_manifold.multiplier**met
    found, last = [], RattleError("")
    for n in entries:
        width = float(run[-1] - run[0])
        for _ in range(MOST_WIDENINGS_OF_WINDOW):  # widen the window until it holds a minimum
            window = (max(run[0] - width, 0.5 * run[0]), run[-1] + width)
            s = here.least_distance_from_stable_manifold(window, n)[1]
            if min(s - window[0], window[1] - s) > 0.1 * (window[1] - window[0]):
                break
            width *= 2.0
        try:
            found.append(
                solve_manifold_contact(delta, beta, (low + high) / 2.0, window, n, (high - low) / (high + low))
            )
        except RattleError as error:
            last = error
    if not found:
        raise last
    return min(found, key=lambda contact: contact.epsilon)


def find_lowest_crisis(delta: float, beta: float, low: float, high: float) -> Crisis:
    """Return the contact of W^u(A) with W^s(A) that has the least ε between SN1 + low and SN1 + high.

    Returns
    -------
    Crisis
        The contact.

    Raises
    ------
    RattleError
        If no contact is found, or W^u(A) still escapes below each contact found.
    """
    for _ in range(MOST_PIECES):
        found = find_manifold_contact_near(delta, beta, low, high)
        below = found.epsilon_above_sn1 * (1.0 - MARGIN)
        if not has_escaping_piece(delta, beta, below, PIECE_DENSITY):
            return found
        low, high = found.epsilon_above_sn1 * (1.0 - 10.0 * MARGIN), below
    raise RattleError(
        f"the least epsilon at which W^u(A) touches W^s(A) is not found at delta = {delta}: below each epsilon that "
        "was found, another piece of W^u(A) becomes quiet"
    )


def boundary_crisis(delta: float, beta: float = 0.6) -> Crisis:
    """Return the boundary crisis at a damping: the contact with the largest ε in which a chaotic attractor ends.

    ε is accurate to 1e-10. W^u(A) is followed at values of ε − SN1 that rise by 4 % each. They end at the quiet limit,
    above which no motion becomes quiet; from δ = 0.3 on they end at ε = 3 SN1 if this is less. In a step in which a
    part of W^u(A) begins to become quiet, the contact is sought with at least 40000 samples per unit of ln s, where s
    is the position on W^u(A). If several pieces of W^u(A) touch W^s(A) in this step, the contact with the least ε is
    taken. The paper does not compute the crisis. Source: docs/crisis.md.

    Returns
    -------
    Crisis
        The crisis, with its ε and the shape of W^u(A) at the contact: a corner or a tangency.

    Raises
    ------
    ParameterError
        If a parameter is outside its domain.
    RattleError
        If no chaotic attractor is observed to end in a contact of W^u(A) with W^s(A); the message has the reasons.
        Below δ = 0.1 the function always raises it.
    """
    delta = require_number("delta", delta, positive=True)
    beta = require_number("beta", beta, positive=True)
    if delta < WEAKEST:
        raise RattleError(
            f"delta must be at least {WEAKEST:g} for a boundary crisis, got {delta:g}: damping is too weak below, "
            "where becoming quiet takes thousands of impacts and few attractors are chaotic; use rattle.crisis_side"
        )
    gaps = _distances_above_sn1_to_try(delta, beta)
    if gaps.size < 2:
        raise RattleError(
            f"the saddle A exists at fewer than two of the tried values of epsilon at delta = {delta}, beta = {beta}: "
            "choose another delta"
        )
    gone = np.asarray(flag_epsilon_with_escaping_part(delta, float(sn1_formula(delta)) + gaps, beta), np.bool_)
    reasons = []
    for i in np.flatnonzero(gone[1:] & ~gone[:-1])[::-1]:
        try:
            found = find_lowest_crisis(delta, beta, *_narrow_escape_range(delta, beta, gaps[i], gaps[i + 1]))
        except RattleError as error:
            reasons.append(str(error))
            continue
        if not is_chaotic_below_crisis(found):
            reason = "the attractor of W^u(A) there is not chaotic"
        elif is_chaotic_above_crisis(found):
            reason = "the chaotic attractor continues at larger epsilon"
        else:
            return found
        reasons.append(f"at epsilon = {found.epsilon:.6f} W^u(A) touches W^s(A), but {reason}")
    if gone[0]:
        reasons.append("W^u(A) already escapes at the smallest epsilon that was tried")
    raise RattleError(
        f"no chaotic attractor ends in a contact of W^u(A) with W^s(A) at delta = {delta}, beta = {beta}: "
        + ("; ".join(reasons) or f"no part of W^u(A) becomes quiet up to epsilon = {sn1_formula(delta) + gaps[-1]:.7f}")
    )
