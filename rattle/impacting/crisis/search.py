"""The boundary crisis at one damping: where in ε W^u(A) escapes, the contacts there, and whether chaos ends."""

from contextlib import suppress

import numpy as np

from rattle.errors import RattleError, require_number
from rattle.impacting.bifurcations.codimension_two import codimension_two
from rattle.impacting.crisis.contact import Crisis, frame, solve_contact
from rattle.impacting.crisis.escape import SAMPLES, FollowedManifold, escapes, is_chaotic_below, outlived, saddle_at
from rattle.impacting.orbits.limits import quiet_limit, sn1_formula
from rattle.impacting.orbits.period_one import period_one
from rattle.orbits.saddles import Array

STEP = 0.04  # of ε − SN1, between two that are tried
LOWEST, SMALLEST = 0.5, 2e-5  # where they begin, relative to the square of the distance from COD22, and to SN1
HIGHEST = 2.0  # where they end, relative to SN1; at weaker damping, where SN1 is far below, at the quiet limit
WEAK, WEAKEST = 0.3, 0.1  # damping below which that is so, and below which nothing is waited for to come to rest
HALVINGS = 6
DENSE, CHECKED = 2000, 40000  # samples per unit of ln s on W^u(A), for the bracket, and once more below the crisis
MARGIN = 1e-4  # how far below the crisis, relative to ε − SN1, no other piece may touch
MOST_PIECES = 6
MOST_RUNS = 4  # of samples that escape, of which the contact is looked for in turn
MOST_STEPS = 400  # of an orbit that escapes
NEAR, GONE = 0.3, 0.5  # a return, relative to the farthest; a speed below which an orbit is on its way to rest
WIDER = 12


def end_of_curve(beta: float) -> float:
    """Return δ of COD22, in which the crisis begins."""
    for point in codimension_two(beta):
        if point.name == "COD22":
            return point.delta
    raise RattleError(f"there is no COD22 at beta = {beta}")


def _gaps(delta: float, beta: float) -> Array:
    """ε − SN1 that are tried: those at which A exists, up to the quiet limit."""
    floor, top = float(sn1_formula(delta)), float(quiet_limit(delta))
    first = LOWEST * floor * min(0.02, max(SMALLEST, (1.0 - delta / end_of_curve(beta)) ** 2))
    last = top * (1.0 - 1e-9) - floor
    if delta >= WEAK:
        last = min(last, HIGHEST * floor)
    if last <= first:
        raise RattleError(
            f"at delta = {delta} there is no rest to escape to where A is born: SN1 is at the quiet limit"
        )
    gaps = first * np.exp(STEP * np.arange(int(np.log(last / first) / STEP) + 1))
    return np.asarray(gaps[period_one(delta, floor + gaps, beta).exists[0]], np.float64)


def _followed(delta: float, beta: float, gap: float, density: int) -> FollowedManifold:
    """W^u(A) at SN1 + gap, by so many samples per unit of ln s. Raises RattleError where nothing is decidable."""
    a = saddle_at(delta, float(sn1_formula(delta)) + gap, beta)
    return FollowedManifold(a, int(SAMPLES + density * np.log(a.multiplier[0])), a.first_excursion)


def touched(delta: float, beta: float, gap: float, density: int) -> bool:
    """Return whether W^u(A) escapes at SN1 + gap."""
    return bool(_followed(delta, beta, gap, density).at_rest.any())


def _narrowed(delta: float, beta: float, low: float, high: float) -> tuple[float, float]:
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (low, middle) if touched(delta, beta, middle, DENSE) else (middle, high)
    return low, high


def _runs(delta: float, beta: float, gap: float) -> list[Array]:
    """Return runs of places s in a fundamental domain of W^u(A) that escape, longest first.

    Each run has one more place on both sides.

    Returns
    -------
    list[Array]
        Rising places s of each run.

    Raises
    ------
    RattleError
        If no piece escapes.
    """
    found = _followed(delta, beta, gap, CHECKED)
    s, gone = found.s[0], found.at_rest[0]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], gone, [False]]).astype(int))).reshape(-1, 2)
    if not edges.size:
        raise RattleError(f"W^u(A) does not escape at epsilon = {sn1_formula(delta) + gap}")
    runs = sorted(edges, key=lambda ends: ends[0] - ends[1])
    return [np.asarray(s[max(first - 1, 0) : last + 1], np.float64) for first, last in runs]


def _orbit(delta: float, beta: float, gap: float, s: float) -> tuple[int, list[int]]:
    """Return the steps after which W(s) first meets Σ⁻, and after which from there it enters the series of W^s(A)."""
    here = frame(delta, float(sn1_formula(delta)) + gap, beta)
    states, met, entries, inside, farthest = here.unstable.image(np.array([s]), 0)[1], -1, [], True, 0.0
    for j in range(MOST_STEPS + int(20.0 / np.log(here.unstable.multiplier))):
        ok, states, _, bounces = here.unstable.map(states, 1)
        if not ok.all():
            break
        if met < 0 and bounces[0] > 0:
            met = max(j - 1, 0)  # a corner's other side meets it one step earlier
        height = float(here.heights(states)[0][0])
        farthest = max(farthest, float(np.hypot(*(states - here.at))[0]))
        before, inside = inside, abs(height) < NEAR * farthest
        if met >= 0 and inside and not before:
            entries.append(j + 1 - met)
        if states[1, 0] < GONE * here.saddle.v:
            break
    return met, entries


def contact_near(delta: float, beta: float, low: float, high: float) -> Crisis:
    """Return the contact of a piece of W^u(A) that escapes at SN1 + high and not at SN1 + low.

    It is that of the longest such piece of which the contact is found.

    Returns
    -------
    Crisis
        Between SN1 + low and SN1 + high.
    """
    *runs, last = _runs(delta, beta, high)[:MOST_RUNS]
    for run in runs:
        with suppress(RattleError):
            return _contact(delta, beta, low, high, run)
    return _contact(delta, beta, low, high, last)


def _contact(delta: float, beta: float, low: float, high: float, run: Array) -> Crisis:
    """Return the contact at the least ε among the returns to A that the orbit in the middle of a run makes."""
    met, entries = _orbit(delta, beta, high, float(run[run.size // 2]))
    if not entries:
        raise RattleError(f"the orbit that escapes at epsilon = {sn1_formula(delta) + high} does not return to A")
    here = frame(delta, float(sn1_formula(delta)) + high, beta)
    run = run * here.unstable.multiplier**met
    found, last = [], RattleError("")
    for n in entries:
        width = float(run[-1] - run[0])
        for _ in range(WIDER):  # until a minimum lies inside
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
    """Return the least ε between SN1 + low and SN1 + high at which W^u(A) touches W^s(A)."""
    for _ in range(MOST_PIECES):
        found = contact_near(delta, beta, low, high)
        below = found.gap * (1.0 - MARGIN)
        if not touched(delta, beta, below, CHECKED):
            return found
        low, high = found.gap * (1.0 - 10.0 * MARGIN), below
    raise RattleError(f"at delta = {delta} ever earlier pieces of W^u(A) touch W^s(A)")


def boundary_crisis(delta: float, beta: float = 0.6) -> Crisis:
    """Return the last contact, by rising ε, in which a chaotic attractor ends, to 1e-10.

    W^u(A) is looked at in steps of 4 % of ε − SN1, up to 3 SN1 (from δ = 0.3 on) or the quiet limit, beyond which
    nothing rests; the piece is the first among those that 40000 points per unit of its ln s show. Raises
    ParameterError, and RattleError where no chaotic attractor is seen to end in a contact with A, saying why, and below
    δ = 0.1. Source: docs/crisis.md; the paper leaves it open.

    Returns
    -------
    Crisis
        With its ε, and whether a corner or a tangency touches W^s(A).

    Raises
    ------
    RattleError
        If no chaotic attractor is seen to end in a contact with A.
    """
    delta = require_number("delta", delta, positive=True)
    beta = require_number("beta", beta, positive=True)
    if delta < WEAKEST:
        raise RattleError(
            f"damping is too weak at delta = {delta:g} for boundary crises: below {WEAKEST:g} motions take thousands "
            "of impacts to come to rest, and what W^u(A) goes to is hardly ever chaotic; rattle.crisis_side tells "
            "whether it goes to rest"
        )
    gaps = _gaps(delta, beta)
    if gaps.size < 2:
        raise RattleError(f"there is no A below the quiet limit at delta = {delta}, beta = {beta}")
    gone = np.asarray(escapes(delta, float(sn1_formula(delta)) + gaps, beta), np.bool_)
    reasons = []
    for i in np.flatnonzero(gone[1:] & ~gone[:-1])[::-1]:
        try:
            found = first_contact(delta, beta, *_narrowed(delta, beta, gaps[i], gaps[i + 1]))
        except RattleError as error:
            reasons.append(str(error))
            continue
        if not is_chaotic_below(found):
            reason = "what attracts W^u(A) there is not chaotic"
        elif outlived(found):
            reason = "the chaotic attractor outlives it"
        else:
            return found
        reasons.append(f"at epsilon = {found.epsilon:.6f} W^u(A) touches W^s(A), but {reason}")
    if gone[0]:
        reasons.append("W^u(A) escapes from where A is born")
    raise RattleError(
        f"no chaotic attractor ends in a contact with A at delta = {delta}, beta = {beta}: "
        + ("; ".join(reasons) or f"W^u(A) stays up to epsilon = {sn1_formula(delta) + gaps[-1]:.7f}")
    )
