"""Period-one motions of many points, regions, and bifurcation curves with restitution and load."""

import math

import numpy as np
import pytest
from depth import either
from scipy.optimize import brentq, minimize_scalar

import rattle
from rattle import inelastic
from rattle.models import Inelastic
from rattle.orbits.orbits_a_to_d import N_MINUS, NAMES, PAPER_REGIONS, REGIONS

Q = 4 * math.pi
WINDOW = {"delta": (0.3, 1.2), "epsilon": (0.0, 0.6)}


def family(s: float, delta: float, beta: float, r: float) -> tuple[float, float, float, float]:
    """ε, phase, departure from Σ⁺ and arrival at Σ⁻ of the P(1,1,1) with time s: four linear equations, as they are.

    Unknown are X = ε cos 2πτ, Y = ε sin 2πτ and the decaying velocities of both flights, b and c.
    """
    cos, sin, w = math.cos(2 * math.pi * s), math.sin(2 * math.pi * s), 2 * math.pi
    es, er = math.exp(-delta * s), math.exp(-delta * (1 - s))
    rows = [
        [cos - 1, -sin, (1 - es) / delta, 0, -2 * beta - Q * s],
        [1 - cos, sin, 0, (1 - er) / delta, 2 * beta - Q * (1 - s)],
        [-w * sin * (1 + r), -w * cos * (1 + r), r * es, 1, -Q * (1 + r)],  # at Σ⁻: departure + r arrival
        [0, -w * (1 + r), 1, r * er, -Q * (1 + r)],
    ]
    a = np.array(rows)
    x, y, b, _c = np.linalg.solve(a[:, :4], a[:, 4])
    leave, reach = Q - w * y + b, Q - w * (x * sin + y * cos) + b * es
    return math.hypot(x, y), math.atan2(y, x) / w % 1.0, -leave, -reach


def excess_at(s: float, delta: float, epsilon: float, r: float) -> float:
    return family(s, delta, 0.6, r)[0] - epsilon


def lowest(tau: float, v: float, delta: float, epsilon: float) -> float:
    """The least Φ − β of the flight from (τ, v) in a period, from the formula of the flight."""
    s = np.linspace(0, 1, 4001)[1:-1]
    e0, slope = epsilon * math.cos(2 * math.pi * tau), -2 * math.pi * epsilon * math.sin(2 * math.pi * tau)

    def height(s: np.ndarray) -> np.ndarray:
        change = epsilon * np.cos(2 * np.pi * (tau + s)) - e0
        return Q * s - (v + slope + Q) * -np.expm1(-delta * s) / delta + change

    i = int(np.argmin(height(s)))
    return float(
        minimize_scalar(height, bounds=(s[max(i - 1, 0)], s[i + 1]), method="bounded", options={"xatol": 1e-13}).fun
    )


def test_elastic_motions_of_many_points_are_those_of_the_elastic_gear() -> None:
    rng = np.random.default_rng(0)
    for scale in (1.0, 0.02):  # at weak damping too
        delta, beta = scale * rng.uniform(0.3, 1.1, 300), scale * rng.uniform(0.5, 0.7, 300)
        epsilon = scale * rng.uniform(0.02, 0.5, 300)
        ours, theirs = inelastic.period_one(delta, epsilon, beta), rattle.period_one(delta, epsilon, beta)
        assert np.array_equal(ours.exists, theirs.exists)
        assert np.array_equal(ours.stable, theirs.stable)
        assert ours.exists.any(axis=1).all()
        for name in ("tau", "v"):
            assert getattr(ours, name) == pytest.approx(getattr(theirs, name), abs=1e-11, nan_ok=True)
        assert np.array_equal(inelastic.regions(delta, epsilon, beta), rattle.regions(delta, epsilon, beta))


@pytest.mark.parametrize("load", [0.0, 0.5])
def test_motions_close_and_have_their_multipliers(load: float) -> None:
    """By the return map; B and D are members of the family, and no other member of it happens."""
    rng, seen = np.random.default_rng(3), np.zeros(4, int)
    for _ in range(either(60, 400)):
        delta, epsilon, r = rng.uniform(0.3, 0.9), (1 + load) * rng.uniform(0.05, 0.35), rng.uniform(0.5, 1.0)
        beta = 0.6 * (1 + load)
        found = inelastic.period_one(delta, epsilon, beta, r, load)
        gear = rattle.inelastic.InelasticGear(delta, epsilon, beta, r, load)
        assert [each.name for each in gear.orbits()] == [
            x for x, is_there in zip(NAMES, found.exists, strict=True) if is_there
        ]
        assert gear.region() == inelastic.regions(delta, epsilon, beta, r, load)
        for i in np.flatnonzero(found.exists):
            step = gear.impact(found.tau[i], found.v[i])
            size = 1.0 + np.abs(step.tangent).max()
            assert step.n_minus == N_MINUS[i]
            assert (step.tau - found.tau[i] + 0.5) % 1.0 - 0.5 == pytest.approx(0.0, abs=1e-11 * size)
            assert step.v == pytest.approx(found.v[i], abs=1e-11 * size)
            assert step.time == pytest.approx(1.0, abs=1e-11 * size)
            assert np.trace(step.tangent) == pytest.approx(found.multipliers[i].sum().real, abs=1e-9 * size**2)
            product = found.multipliers[i].prod().real
            assert product == pytest.approx(math.exp(-delta) * r ** (2 + 2 * N_MINUS[i]), rel=1e-9)
            assert found.stable[i] == (abs(found.multipliers[i]).max() < 1.0)
            seen[i] += 1
    assert (seen > 3).all()


def test_all_members_of_the_family_that_happen_are_found() -> None:
    """Every root of ε(s), by plain linear equations, that the return map confirms is B or D."""
    rng, seen = np.random.default_rng(8), 0
    grid = np.linspace(0, 1, 1500)[1:-1]  # without 1/2, the pole
    for _ in range(either(12, 100)):
        delta, epsilon, r = rng.uniform(0.3, 0.8), rng.uniform(0.08, 0.3), rng.uniform(0.6, 1.0)
        gear = rattle.inelastic.InelasticGear(delta, epsilon, 0.6, r)
        excess = np.array([excess_at(s, delta, epsilon, r) for s in grid])
        letters = set()
        for i in np.flatnonzero((excess[1:] * excess[:-1] < 0) & (np.abs(excess[1:] - excess[:-1]) < 1.0)):
            s = brentq(excess_at, grid[i], grid[i + 1], args=(delta, epsilon, r), xtol=1e-15)
            _size, tau, v, u = family(s, delta, 0.6, r)
            if v <= 0.0 or u <= 0.0:
                continue
            step = gear.impact(tau, v)
            if step.n_minus == 1 and abs(step.v - v) < 1e-7 and abs(step.time - 1.0) < 1e-7:
                letters.add("D" if excess[i + 1] > excess[i] else "B")
        assert letters == {each.name for each in gear.orbits()} & {"B", "D"}
        seen += len(letters)
    assert seen > 5


@pytest.mark.parametrize("name", inelastic.NAMES)
def test_elastic_curves_are_those_of_the_elastic_gear(name: str) -> None:
    ours, theirs = inelastic.trace(name, **WINDOW), rattle.curves.trace(name, **WINDOW)
    ends = [[(x.delta[end.index], x.epsilon[end.index]) for end in x.ends] for x in (ours, theirs)]
    assert np.array(ends[0]) == pytest.approx(np.array(ends[1]), abs=1e-7)  # the elastic ones end just before COD23
    for delta in np.linspace(0.31, 1.19, 23):
        assert ours.at(delta=delta) == pytest.approx(theirs.at(delta=delta), abs=1e-9)
    assert [end.reason[:5] for end in ours.ends] == [end.reason[:5] for end in theirs.ends]  # with the points met


@pytest.mark.parametrize(
    ("r", "born", "flip"),
    [(1.0, 0.0596430582, 0.2055258549), (0.9, 0.0912220056, 0.2227891783), (0.8, 0.1263097249, 0.2466397644)],
)
def test_saddle_node_and_flip_of_the_bounce(r: float, born: float, flip: float) -> None:
    assert inelastic.trace("SN1", 0.6, r, **WINDOW).at(delta=0.6) == pytest.approx((born,), abs=1e-9)
    for delta in (0.4, 0.5):
        found = inelastic.trace("PDC", 0.6, r, **WINDOW).at(delta=delta)
        assert found == pytest.approx((inelastic.epsilon_of_flip_of_c(delta, r, Q),), abs=1e-12)
    assert inelastic.epsilon_of_flip_of_c(0.6, r, Q) == pytest.approx(flip, abs=1e-9)


@pytest.mark.parametrize("load", [0.0, 0.5])
@pytest.mark.parametrize("name", ["SN1", "SN2", "PD1", "G1", "G2", "PDC", "PD2"])
def test_what_ends_or_changes_at_a_curve(name: str, load: float) -> None:
    """The set of orbits and their stability just below and just above it, by the return map."""
    changes = {  # what exists below, and above; small letters: a stable one
        "SN1": ("", "Ac"),
        "SN2": ("Ac", "ABcd"),
        "PD1": ("d", "D"),
        "G1": ("ABCD", "AD"),
        "G2": ("", "AD"),
        "PDC": ("c", "C"),
        "PD2": ("D", "d"),
    }
    r = 0.9
    curve = inelastic.trace(name, 0.6 * (1 + load), r, load, delta=(0.3, 1.4), epsilon=(0.0, 1.0))
    assert len(curve) >= 8
    middle = curve.delta[len(curve) // 3] if name != "G2" else 1.0
    middle = 0.62 if name == "SN1" else middle
    (first, *_) = curve.at(delta=middle)
    for before, side in zip(changes[name], (-1.0, 1.0), strict=True):
        epsilon = first * (1.0 + side * 1e-4)
        gear = rattle.Gear(middle, epsilon, 0.6 * (1 + load), restitution=r, load=load)
        found = "".join(each.name.lower() if each.stable else each.name for each in gear.orbits())
        if len(before) == 1:  # one letter, whatever else there is
            assert before in found, found
            assert before.swapcase() not in found
        else:
            assert (found.upper() if name == "G1" else found) == before
        for each in gear.orbits():
            assert gear.impact(each.tau, each.v).v == pytest.approx(each.v, abs=1e-8)


@pytest.mark.parametrize("r", [0.98, 0.8, 0.6])
def test_fold_of_the_family(r: float) -> None:
    """SN2 is the least ε of the family of P(1,1,1), and a multiplier is 1 there."""
    curve = inelastic.trace("SN2", 0.6, r, **WINDOW)
    for delta in (0.4, 0.55):
        (epsilon,) = curve.at(delta=delta)
        grid = np.linspace(0.51, 0.95, 400)
        i = int(np.argmin([family(s, delta, 0.6, r)[0] for s in grid]))
        least = minimize_scalar(
            excess_at,
            args=(delta, 0.0, r),
            bounds=(grid[i - 1], grid[i + 1]),
            method="bounded",
            options={"xatol": 1e-12},
        )
        assert epsilon == pytest.approx(least.fun, abs=1e-10)
    multipliers = curve.multipliers
    assert np.abs(multipliers - 1.0).min(axis=0) == pytest.approx(0.0, abs=1e-4)
    assert multipliers.prod(axis=0).real == pytest.approx(np.exp(-curve.delta) * r**4, rel=1e-8)


@pytest.mark.parametrize("name", ["G1", "G2"])
def test_grazing_motions_touch_the_wall(name: str) -> None:
    for r, load in ((0.9, 0.0), (0.7, 0.4)):
        curve = inelastic.trace(name, 0.6, r, load, delta=(0.3, 1.4), epsilon=(0.0, 1.0))
        assert curve.v == pytest.approx(curve.delta * r * Q * (1 + load) / (1 + r), rel=1e-9)
        for i in range(1, len(curve) - 1, 7):
            unit = 1 + load
            touch = lowest(curve.tau[i], curve.v[i] / unit, curve.delta[i], curve.epsilon[i] / unit)
            assert touch == pytest.approx(-1.2 / unit, abs=1e-9)


@pytest.mark.parametrize("name", ["SN1", "SN2", "PD1", "G1", "PDC", "PD2", "quiet_limit"])
def test_a_load_changes_the_unit_of_length(name: str) -> None:
    loaded = inelastic.trace(name, 0.9, 0.85, 0.5, **WINDOW)
    plain = inelastic.trace(name, 0.6, 0.85, 0.0, delta=WINDOW["delta"], epsilon=(0.0, 0.4))
    for delta in (0.31, 0.33, 0.35):
        found, known = loaded.at(delta=delta), plain.at(delta=delta)
        assert len(known) > 0
        assert found == pytest.approx(tuple(1.5 * x for x in known), abs=1e-12)


def test_quiet_limit_of_any_forcing() -> None:
    for load, harmonics in ((0.0, ()), (0.4, [(3, 0.05, 0.2), (7, 0.01, 0.6)])):
        curve = inelastic.trace("quiet_limit", 0.6, 0.9, load, harmonics, **WINDOW)
        for delta in (0.35, 0.6, 1.1):
            limit = inelastic.quiet_limit(delta, Q * (1 + load), harmonics)
            assert min(abs(x - limit) for x in curve.at(delta=delta)) < 1e-12
        limits = [inelastic.quiet_limit(delta, Q * (1 + load), harmonics) for delta in curve.delta]
        assert curve.epsilon == pytest.approx(np.array(limits), rel=1e-8)


def test_regions_of_the_paper_remain() -> None:
    delta, epsilon = np.meshgrid(np.linspace(0.4, 1.0, 40), np.linspace(0.005, 0.3, 30))
    for r in (1.0, 0.98, 0.9):
        seen = {REGIONS[code] for code in np.unique(inelastic.regions(delta, epsilon, 0.6, r))}
        assert seen == set(PAPER_REGIONS)


def test_what_harmonics_leave() -> None:
    model = Inelastic(0.6, 0.9, harmonics=((3, 0.1, 0.0),))
    with pytest.raises(rattle.RattleError, match="of one cosine only: leave out the harmonics"):
        model.period_one(0.6, 0.1)
    with pytest.raises(rattle.RattleError, match="SN1 is traced for a forcing of one cosine only"):
        model.trace("SN1", *WINDOW.values())
    assert len(model.trace("quiet_limit", *WINDOW.values())) > 10
    assert model.codimension_two() == ()
    with pytest.raises(rattle.ParameterError, match="name must be"):
        inelastic.trace("SN7")
    with pytest.raises(rattle.ParameterError, match="restitution must be at most 1"):
        inelastic.trace("SN1", 0.6, 1.1)
    assert all(inelastic.describe(name) for name in inelastic.NAMES)
