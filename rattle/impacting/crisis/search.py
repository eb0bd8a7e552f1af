"""Find the boundary crisis at one damping: the ε from which W^u(A) escapes, the contact there, and whether chaos ends.

W^u(A) escapes if a part of it becomes quiet.
"""

from contextlib import suppress

import numpy as np

from rattle.errors import RattleError, require_number
from rattle.impacting.bifurcations.codimension_two import codimension_two
from rattle.impacting.crisis.contact import Crisis, frame, solve_contact
from rattle.impacting.crisis.escape import SAMPLES, FollowedManifold, escapes, is_chaotic_below, outlived, saddle_at
from rattle.impacting.orbits.limits import quiet_limit, sn1_formula
from rattle.impacting.orbits.period_one import period_one
from rattle.orbits.saddles import Array

STEP = 0.04  # relative step in ε − SN1
# the first ε − SN1 is LOWEST · SN1 times the squared relative distance in δ from COD22, which counts as SMALLEST at
# least
LOWEST, SMALLEST = 0.5, 2e-5
HIGHEST = 2.0  # last ε − SN1, relative to SN1; at weak damping the search ends at the quiet limit, far above SN1
WEAK, WEAKEST = 0.3, 0.1  # damping below which the search ends at the quiet limit, and below which it is refused
HALVINGS = 6  # bisections of a step in ε − SN1 in which W^u(A) begins to escape
# samples per unit of ln s on W^u(A), for the bracket and for the final check below the crisis
DENSE, CHECKED = 2000, 40000
MARGIN = 1e-4  # distance below the crisis, relative to ε − SN1, at which no other piece of W^u(A) may escape
MOST_PIECES = 6  # most contacts that are replaced by an earlier one
MOST_RUNS = 4  # most runs of escaping samples whose contacts are tried in turn
MOST_STEPS = 400  # most impacts of an escaping orbit
# a return is nearer to W^s(A) than this share of the farthest distance from A so far; an orbit slower than this share
# of the speed of A is becoming quiet
NEAR, GONE = 0.3, 0.5
WIDER = 12  # most doublings of the width of a window


def end_of_curve(beta: float) -> float:
    """Return δ of COD22, where the crisis curve ends."""
    for point in codimension_two(beta):
        if point.name == "COD22":
            return point.delta
    raise RattleError(f"the point COD22, where the curve of crises ends, does not exist at beta = {beta}")


def _gaps(delta: float, beta: float) -> Array:
    """Return the values of ε − SN1 to try, up to the quiet limit: those at which A exists."""
    floor, top = float(sn1_formula(delta)), float(quiet_limit(delta))
    first = LOWEST * floor * min(0.02, max(SMALLEST, (1.0 - delta / end_of_curve(beta)) ** 2))
    last = top * (1.0 - 1e-9) - floor
    if delta >= WEAK:
        last = min(last, HIGHEST * floor)
    if last <= first:
        raise RattleError(
            f"at delta = {delta} the saddle A is born at the quiet limit, so no quiet motion exists to escape to"
        )
    gaps = first * np.exp(STEP * np.arange(int(np.log(last / first) / STEP) + 1))
    return np.asarray(gaps[period_one(delta, floor + gaps, beta).exists[0]], np.float64)


def _followed(delta: float, beta: float, gap: float, density: int) -> FollowedManifold:
    """Return W^u(A) at ε = SN1 + gap, with `density` samples per unit of ln s. Errors are those of `saddle_at`."""
    a = saddle_at(delta, float(sn1_formula(delta)) + gap, beta)
    return FollowedManifold(a, int(SAMPLES + density * np.log(a.multiplier[0])), a.first_excursion)


def touched(delta: float, beta: float, gap: float, density: int) -> bool:
    """Return whether W^u(A) escapes at ε = SN1 + gap, to `density` samples per unit of ln s."""
    return bool(_followed(delta, beta, gap, density).at_rest.any())


def _narrowed(delta: float, beta: float, low: float, high: float) -> tuple[float, float]:
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (low, middle) if touched(delta, beta, middle, DENSE) else (middle, high)
    return low, high


def _runs(delta: float, beta: float, gap: float) -> list[Array]:
    """Return runs of positions s in a fundamental domain of W^u(A) that escape, the longest first.

    Each run includes one more position on either side, which does not escape.

    Returns
    -------
    list[Array]
        Rising positions s of each run.

    Raises
    ------
    RattleError
        If no piece escapes.
    """
    found = _followed(delta, beta, gap, CHECKED)
    s, gone = found.s[0], found.at_rest[0]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], gone, [False]]).astype(int))).reshape(-1, 2)
    if not edges.size:
        raise RattleError(
            f"no piece of W^u(A) becomes quiet at epsilon = {sn1_formula(delta) + gap}, so no crisis has happened there"
        )
    runs = sorted(edges, key=lambda ends: ends[0] - ends[1])
    return [np.asarray(s[max(first - 1, 0) : last + 1], np.float64) for first, last in runs]


def _orbit(delta: float, beta: float, gap: float, s: float) -> tuple[int, list[int]]:
    """Return the number of returns until W(s) meets Σ⁻, and from there to each approach to the series of W^s(A)."""
    here = frame(delta, float(sn1_formula(delta)) + gap, beta)
    states, met, entries, inside, farthest = here.unstable.image(np.array([s]), 0)[1], -1, [], True, 0.0
    for j in range(MOST_STEPS + int(20.0 / np.log(here.unstable.multiplier))):
        ok, states, _, bounces = here.unstable.map(states, 1)
        if not ok.all():
            break
        if met < 0 and bounces[0] > 0:
            met = max(j - 1, 0)  # at a corner, orbits on the other side meet Σ⁻ one step earlier
        height = float(here.heights(states)[0][0])
        farthest = max(farthest, float(np.hypot(*(states - here.at))[0]))
        before, inside = inside, abs(height) < NEAR * farthest
        if met >= 0 and inside and not before:
            entries.append(j + 1 - met)
        if states[1, 0] < GONE * here.saddle.v:
            break
    return met, entries


def contact_near(delta: float, beta: float, low: float, high: float) -> Crisis:
    """Return the contact of a piece of W^u(A) that escapes at SN1 + high but not at SN1 + low.

    It is the contact of the longest such piece for which a contact is found.

    Returns
    -------
    Crisis
        The contact, with ε near the range from SN1 + low to SN1 + high.
    """
    *runs, last = _runs(delta, beta, high)[:MOST_RUNS]
    for run in runs:
        with suppress(RattleError):
            return _contact(delta, beta, low, high, run)
    return _contact(delta, beta, low, high, last)


def _contact(delta: float, beta: float, low: float, high: float, run: Array) -> Crisis:
    """Return the contact with the least ε of the contacts at all returns to A of the orbit in the middle of a run."""
    met, entries = _orbit(delta, beta, high, float(run[run.size // 2]))
    if not entries:
        raise RattleError(
            f"the escaping orbit at epsilon = {sn1_formula(delta) + high} does not return to A: no contact"
        )
    here = frame(delta, float(sn1_formula(delta)) + high, beta)
    run = run * here.unstable.multiplier**met
    found, last = [], RattleError("")
    for n in entries:
        width = float(run[-1] - run[0])
        for _ in range(WIDER):  # widen the window until it holds a minimum
            window = (max(run[0] - width, 0.5 * run[0]), run[-1] + width)
            s = here.least(window, n)[1]
            if min(s - window[0], window[1] - s) > 0.1 * (window[1] - window[0]):
                break
            width *= 2.0
        try:
            found.append(solve_contact(delta, beta, (low + high) / 2.0, window, n, (high - low) / (high + low)))
        except RattleError as error:
            last = error
    if not found:
        raise last
    return min(found, key=lambda contact: contact.epsilon)


def first_contact(delta: float, beta: float, low: float, high: float) -> Crisis:
    """Return the contact with the least ε between SN1 + low and SN1 + high."""
    for _ in range(MOST_PIECES):
        found = contact_near(delta, beta, low, high)
        below = found.gap * (1.0 - MARGIN)
        if not touched(delta, beta, below, CHECKED):
            return found
        low, high = found.gap * (1.0 - 10.0 * MARGIN), below
    raise RattleError(f"no first contact at delta = {delta}: each refinement shows an earlier piece of W^u(A)")


def boundary_crisis(delta: float, beta: float = 0.6) -> Crisis:
    """Return the boundary crisis at a damping: the last contact, by rising ε, in which a chaotic attractor ends.

    ε is accurate to 1e-10. W^u(A) is followed at steps of 4 % in ε − SN1, up to 3 SN1 (from δ = 0.3 on) or the quiet
    limit, beyond which nothing becomes quiet. The piece that touches is the first among the pieces that 40000 samples
    per unit of ln s resolve. The paper leaves the crisis open. Source: docs/crisis.md.

    Returns
    -------
    Crisis
        With its ε, and whether a corner or a tangency touches W^s(A).

    Raises
    ------
    ParameterError
        If a parameter is outside its domain.
    RattleError
        If no chaotic attractor is observed to end in a contact with A, with the reasons; always below δ = 0.1.
    """
    delta = require_number("delta", delta, positive=True)
    beta = require_number("beta", beta, positive=True)
    if delta < WEAKEST:
        raise RattleError(
            f"damping is too weak at delta = {delta:g} for boundary crises: below {WEAKEST:g} motions take thousands "
            "of impacts to come to rest, and the attractor of W^u(A) is hardly ever chaotic; rattle.crisis_side tells "
            "whether it goes to rest"
        )
    gaps = _gaps(delta, beta)
    if gaps.size < 2:
        raise RattleError(f"the saddle A does not exist below the quiet limit at delta = {delta}, beta = {beta}")
    gone = np.asarray(escapes(delta, float(sn1_formula(delta)) + gaps, beta), np.bool_)
    reasons = []
    for i in np.flatnonzero(gone[1:] & ~gone[:-1])[::-1]:
        try:
            found = first_contact(delta, beta, *_narrowed(delta, beta, gaps[i], gaps[i + 1]))
        except RattleError as error:
            reasons.append(str(error))
            continue
        if not is_chaotic_below(found):
            reason = "the attractor of W^u(A) there is not chaotic"
        elif outlived(found):
            reason = "the chaotic attractor continues at larger epsilon"
        else:
            return found
        reasons.append(f"at epsilon = {found.epsilon:.6f} W^u(A) touches W^s(A), but {reason}")
    if gone[0]:
        reasons.append("W^u(A) already escapes at the smallest epsilon that was tried")
    raise RattleError(
        f"no chaotic attractor ends in a contact with A at delta = {delta}, beta = {beta}: "
        + ("; ".join(reasons) or f"no part of W^u(A) becomes quiet up to epsilon = {sn1_formula(delta) + gaps[-1]:.7f}")
    )
