"""Attractors of the inelastic gear: tables of a slow simulation, and shares of random gears by a brute force."""

import re
from collections import Counter

import numpy as np
import pytest
from depth import either
from inelastic_march import MOST_PERIOD, shares

import rattle
from rattle.inelastic import InelasticGear

DRAWING = 0.003333, 3e-4, 1e-3  # 15 µm
MESH = 1e-6 / 0.05 / 3e-4  # amplitude over ε of 1 µm


def found(gear: InelasticGear, count: int = 256) -> Counter[str]:
    return Counter({x.name: x.fraction for x in gear.attractors(count)})


def near(share: float, expected: float, count: int, simulated: int) -> bool:
    """Within 3.5 standard errors of the difference; a share of 0 or 1 has that of half a sample."""
    spread = max(expected * (1 - expected), 0.25 / simulated)
    return abs(share - expected) < 3.5 * np.sqrt(spread * (1 / count + 1 / simulated)) + 1 / count


@pytest.mark.parametrize(
    ("r", "expected"),
    [
        (0.99, {"quiet": 0.72, "P(4,4,2)": 0.20, "P(1,1,0)": 0.08}),
        (0.95, {"quiet": 0.79, "P(1,1,0)": 0.16, "P(4,4,2)": 0.03, "P(3,3,2)": 0.03}),
        (0.9, {"quiet": 0.81, "P(1,1,0)": 0.19}),
        (0.8, {"quiet": 1.0}),
        (0.6, {"quiet": 1.0}),
    ],
)
def test_the_point_of_the_paper(r: float, expected: dict[str, float]) -> None:
    ours = found(InelasticGear(0.6, 0.1, 0.6, r))
    for name in {*expected, *ours}:
        assert near(ours[name], expected.get(name, 0.0), 256, 150), (name, ours)


@pytest.mark.parametrize(
    ("r", "expected"),
    [(0.99, {"quiet": 0.87, "P(1,2,0)": 0.13}), (0.95, {"quiet": 1.0}), (0.9, {"quiet": 1.0}), (0.8, {"quiet": 1.0})],
)
def test_the_drawing(r: float, expected: dict[str, float]) -> None:
    ours = found(InelasticGear(*DRAWING, r), 128)
    for name in {*expected, *ours}:
        assert near(ours[name], expected.get(name, 0.0), 128, 60), (name, ours)


@pytest.mark.parametrize(
    ("micrometres", "quiet", "one"), [(0.02, 1.0, 0.0), (0.05, 0.70, 0.30), (0.08, 0.33, 0.68), (0.10, 0.0, 0.68)]
)
def test_the_drawing_with_an_error_of_the_mesh(micrometres: float, quiet: float, one: float) -> None:
    gear = InelasticGear(*DRAWING, 0.9, 0.0, [(20, micrometres * MESH, 0.0)])
    ours = found(gear, 128)
    assert near(ours["quiet"], quiet, 128, 40), ours
    assert near(ours["P(1,20,0)"], one, 128, 40), ours


def random_gear(rng: np.random.Generator) -> InelasticGear:
    """Restitution 0.5 to 0.98, up to five harmonics, above and below the quiet limit, weak damping too."""
    delta, r = float(np.exp(rng.uniform(np.log(0.05), np.log(0.9)))), float(rng.uniform(0.5, 0.98))
    orders = rng.choice(np.arange(2, 13), int(rng.integers(0, 5)), replace=False)
    harmonics = [(int(k), float(rng.random() * 0.7 / k**2), float(rng.random())) for k in orders]
    load = float(rng.choice([0.0, 0.0, 0.5]))
    beta = float(delta * rng.uniform(0.3, 2.0))
    limit = InelasticGear(delta, 0.1, beta, r, load, harmonics).quiet_limit
    return InelasticGear(delta, float(limit * rng.uniform(0.4, 2.0)), beta, r, load, harmonics)


def as_the_brute_force_says(name: str) -> str:
    """A label that the brute force can give: it looks for short periods only."""
    period = re.match(r"P\((\d+),", name)
    return name if name == "quiet" or (period and int(period[1]) <= MOST_PERIOD) else "other"


def test_shares_of_random_gears() -> None:
    rng, count, seen = np.random.default_rng(60), 48, Counter()
    for _ in range(either(10, 40)):
        gear = random_gear(rng)
        tau, v = rng.random(count), rng.random(count) * gear._highest_speed("natural")
        reached = gear.reached(tau, v)
        ours = Counter(as_the_brute_force_says(reached.attractors[i].name) for i in reached.which)
        numbers = gear.delta, gear.epsilon, gear.beta, gear.restitution, gear.load, list(gear.harmonics)
        theirs = shares(*numbers, tau, v, max(300.0, 40.0 / gear.delta))
        for name in {*ours, *theirs}:
            assert near(ours[name] / count, theirs[name] / count, count, count), (gear, ours, theirs)
        seen += Counter(each.kind for each in reached.attractors)
        assert sum(x.fraction for x in reached.attractors if x.kind == "undecided") <= 0.02 + 1 / count
    assert seen["periodic"] > 5
    assert seen["quiet"] > 2


def test_labels_with_contact() -> None:
    """A motion with contact: its multipliers are 0, its exponents −∞, and its name has the number of its phases."""
    gear = InelasticGear(0.6, 0.25, 0.6, 0.5)
    phases = [x for x in gear.attractors(64) if x.contacts]
    assert phases
    for x in phases:
        assert x.name == f"P({x.m},{x.n_plus},{x.n_minus};{x.contacts})"
        assert x.lyapunov == (-np.inf, -np.inf)


def test_a_cell_does_not_depend_on_the_others() -> None:
    delta, epsilon = np.array([0.4, 0.6, 0.7]), np.array([0.1, 0.2, 0.3])
    every = rattle.inelastic.attractors_of(delta, epsilon, 0.6, 0.8, 0.0, [(3, 0.05, 0.2)], count=32)
    for i in range(3):
        one = rattle.inelastic.attractors_of(delta[i], epsilon[i], 0.6, 0.8, 0.0, [(3, 0.05, 0.2)], count=32)
        mine = every.take(every.cell == i)
        for name, values in one.columns().items():
            if name != "cell":
                np.testing.assert_array_equal(values, mine.columns()[name])


def test_restitution_near_one_tends_to_the_elastic_gear() -> None:
    """The distance of a state after ten impacts falls in proportion to 1 − r."""
    tau, v = np.linspace(0.05, 0.95, 20), np.linspace(1.0, 6.0, 20)
    elastic = rattle.iterate(0.6, 0.1, tau, v, 3)
    far = []
    for loss in (1e-6, 1e-8):
        near_one = rattle.inelastic.iterate(0.6, 0.1, tau, v, 3, 0.6, 1 - loss)
        far.append(np.median(np.abs(near_one.v - elastic.v)))
    assert far[0] / far[1] == pytest.approx(100, rel=0.2)
    same = rattle.inelastic.iterate(0.6, 0.1, tau, v, 3)
    np.testing.assert_allclose(same.v, elastic.v, rtol=1e-9)
