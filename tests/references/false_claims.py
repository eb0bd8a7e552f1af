"""False claims about periodic motions, each beside a true one: for the finder as altered motions, for the checker as
altered certificates.

    python tests/references/false_claims.py [NUMBER]

tries so many (1000) of each kind on both and prints how many were proved: it must be none.
"""

import json
import math
import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from unittest.mock import patch

import numpy as np

import rattle
from rattle.impacting.orbits.equations import Itinerary
from rattle.impacting.orbits.periodic import PeriodicOrbit, orbit_of
from rattle.orbits.periodic_motions import PeriodicMotion, solve_at_parameters
from rattle.proof.check import Refusal, check
from rattle.stiff import StiffGear
from rattle.stiff.orbits.equations import StiffItinerary
from rattle.stiff.orbits.periodic import StiffOrbit
from rattle.stiff.orbits.periodic import orbit_of as stiff_orbit_of

MOVED = 1e-6
MOST = 8  # impacts
Claim = tuple[PeriodicMotion, str]  # a motion, and a certificate that is not the finder's


def motions(rng: np.random.Generator, stiff: bool) -> Iterator[PeriodicMotion]:
    """True motions, stable or not, at random points of the plane."""
    while True:
        delta, epsilon = rng.uniform(0.4, 1.0), rng.uniform(0.02, 0.3)
        gear = StiffGear(delta, epsilon, 0.6, 10 ** rng.uniform(2, 6)) if stiff else rattle.Gear(delta, epsilon)
        starts = [(each.tau, each.v, 1) for each in gear.orbits()]
        found = gear.attractors(count=8, seed=int(rng.integers(1 << 30)))
        starts += [(each.tau, each.v, each.n_plus) for each in found if 1 < each.n_plus + each.n_minus <= MOST]
        for start in starts:
            try:
                yield gear.orbit(*start)
            except rattle.RattleError:
                continue


def certificate(orbit: PeriodicMotion) -> dict:
    """The document of a motion, whether its pieces happen or not."""
    with patch("rattle.proof.flights.enclose_extrema", lambda *_: ()):
        return rattle.certify(orbit).document()


def moved(orbit: PeriodicMotion, rng: np.random.Generator) -> Claim:
    """All times moved by 1e-6."""
    by = rng.normal(size=orbit.times.size)
    by *= MOVED / np.abs(by).max()
    document = certificate(orbit)
    each = len(document["times"]) // by.size
    times = [f"{float(t) + by[i // each]:.20f}" for i, t in enumerate(document["times"])]
    return replace(orbit, times=orbit.times + by), json.dumps({**document, "times": times})


def mislabelled(orbit: PeriodicMotion, rng: np.random.Generator) -> Claim:
    """More forcing periods, another wall, an impact left out, or the same motion twice."""
    document, walls = certificate(orbit), orbit.walls
    each, which = len(document["times"]) // len(walls), int(rng.integers(4))
    if which == 1 or (which == 2 and len(walls) == 1):
        at = int(rng.integers(len(walls)))
        new = tuple(-wall if i == at else wall for i, wall in enumerate(walls))
        return replace(orbit, walls=new), json.dumps(relabelled(document, new))
    if which == 2:
        kept = np.arange(len(walls)) != (at := int(rng.integers(1, len(walls))))
        new = walls[:at] + walls[at + 1 :]
        less = {name: getattr(orbit, name)[kept] for name in ("times", "durations", "speeds") if hasattr(orbit, name)}
        listed = np.repeat(kept, each)
        arrays = {name: [x for x, k in zip(document[name], listed, strict=True) if k] for name in ("times", "speeds")}
        return replace(orbit, walls=new, **less), json.dumps({**relabelled(document, new), **arrays})
    if which == 3:
        twice = {"walls": walls * 2, "m": 2 * orbit.m, "times": np.append(orbit.times, orbit.times + orbit.m)}
        twice |= {name: np.tile(getattr(orbit, name), 2) for name in ("durations", "speeds") if hasattr(orbit, name)}
        twice["multipliers"] = tuple(x * x for x in orbit.multipliers)
        times = document["times"] + [f"{float(t) + orbit.m:.28f}" for t in document["times"]]
        same = {**relabelled(document, walls * 2, 2 * orbit.m), "times": times, "speeds": document["speeds"] * 2}
        return replace(orbit, **twice), json.dumps(same)
    periods = orbit.m + int(rng.integers(1, 3))
    return replace(orbit, m=periods), json.dumps(relabelled(document, walls, periods))


def relabelled(document: dict, walls: tuple[int, ...], m: int | None = None) -> dict:
    """The document with other walls, and a label that counts them."""
    label = [m or document["label"][0], walls.count(1), walls.count(-1)]
    return {**document, "walls": list(walls), "label": label}


def elsewhere(orbit: PeriodicMotion, rng: np.random.Generator) -> Claim:
    """The motion of a point of the plane 1e-6 away."""
    name = ("delta", "epsilon")[int(rng.integers(2))]
    value = getattr(orbit, name) + MOVED * (1 if rng.random() < 0.5 else -1)
    document = certificate(orbit)
    parameters = {**document["parameters"], name: f"{value:.20f}"}
    return replace(orbit, **{name: value}), json.dumps({**document, "parameters": parameters})


def called_attracting(orbit: PeriodicMotion, _rng: np.random.Generator) -> Claim | None:
    """A saddle with the multipliers of an attractor; None of what attracts."""
    if orbit.stable:
        return None
    determinant = math.exp(-orbit.delta * orbit.m)
    said = {"trace": ["-0.001", "0.001"], "verdict": "attracting"}
    multipliers = (complex(0, determinant**0.5), complex(0, -(determinant**0.5)))
    return replace(orbit, multipliers=multipliers), json.dumps({**certificate(orbit), **said})


def virtual(rng: np.random.Generator, stiff: bool) -> Iterator[Claim]:
    """Solutions of the equations whose flights pass a wall: A and C beyond their grazes, motions without an impact."""
    true = motions(rng, stiff=False)
    while True:
        if rng.random() < 0.5:
            delta = rng.uniform(0.4, 1.0)
            epsilon, offset = rng.uniform(0.02, 0.3), 2 - delta / math.tanh(delta / 2)
            if epsilon <= abs(offset):
                continue
            tau = math.asin(offset / epsilon) / (2 * math.pi)
            x = np.array([tau if rng.random() < 0.5 else 0.5 - tau, delta, epsilon])
            found = orbit_of(Itinerary((1,), 1, 0.6), x)
        else:
            found = without_an_impact(next(true), rng)
        if found is not None and stiff:
            found = with_contacts(found, 10 ** rng.uniform(4, 6))
        if found is not None and not found.admissible and (found.speeds > 1e-3).all():
            yield replace(found, admissible=True), json.dumps(certificate(found))


def with_contacts(orbit: PeriodicOrbit, kappa: float) -> StiffOrbit | None:
    """The solution of the stiff gear near one of its limit, if there is one."""
    itinerary = StiffItinerary(orbit.walls, orbit.m, orbit.beta, (2 * kappa) ** -0.5)
    start = np.concatenate([orbit.times, np.full(orbit.times.size, np.pi), [orbit.delta, orbit.epsilon]])
    found = solve_at_parameters(itinerary, start)
    return None if found is None or (found[orbit.times.size : -2] < 1).any() else stiff_orbit_of(itinerary, found)


def without_an_impact(orbit: PeriodicOrbit, rng: np.random.Generator) -> PeriodicOrbit | None:
    """A solution near that leaves an impact out, if there is one."""
    n = len(orbit.walls)
    if n < 2:
        return None
    at = int(rng.integers(1, n))
    itinerary = orbit.itinerary.without_impact(at)
    found = solve_at_parameters(itinerary, np.delete(orbit.unknowns, at))
    try:
        return None if found is None or (np.diff(found[: n - 1]) <= 0).any() else orbit_of(itinerary, found)
    except (rattle.RattleError, FloatingPointError):
        return None


ALTERED = {"moved": moved, "wrong label": mislabelled, "neighbouring parameter": elsewhere}
KINDS = (*ALTERED, "called attracting", "virtual")


def claims(kind: str, seed: int, stiff: bool = False) -> Iterator[Claim]:
    """False claims of a kind, without end."""
    rng = np.random.default_rng([seed, *kind.encode()])
    if kind == "virtual":
        yield from virtual(rng, stiff)
    alter = ALTERED.get(kind, called_attracting)
    for orbit in motions(rng, stiff):
        try:
            altered = alter(orbit, rng)
        except rattle.NotProvedError:
            continue
        if altered is not None:
            yield altered


def answers(claim: Claim) -> tuple[str, str]:
    """Why the finder and why the checker refuses a claim; "" if it proves it."""
    orbit, document = claim
    try:
        verdict = rattle.certify(orbit).verdict
        finder = "" if verdict == "attracting" or not orbit.stable else f"it is {verdict}"
    except rattle.NotProvedError as why:
        finder = str(why)
    try:
        check(document)
    except Refusal as why:
        return finder, str(why)
    return finder, ""


def main(number: int) -> None:
    """Print how many of each kind were proved, and why most were not."""
    for stiff in (False, True):
        for kind in KINDS:
            given = claims(kind, 26, stiff)
            tried = [answers(next(given)) for _ in range(number)]
            for who, why in zip(("finder", "checker"), zip(*tried, strict=True), strict=True):
                said = Counter(re.sub(r"[-+]?[\d.]+(e[-+]\d+)?", "#", each)[:60] for each in why if each)
                proved, gear = why.count(""), "stiff" if stiff else "impacting"
                print(f"{gear}, {kind}, {who}: {proved} of {number} proved; {said.most_common(3)}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if sys.argv[1:] else 1000)
