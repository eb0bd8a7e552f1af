"""Impacts and intensities of the inelastic gear: exact balances, an independent brute force, and the elastic limit."""

import math

import numpy as np
import pytest
from depth import either
from inelastic_march import IMPACT, march

import rattle
from rattle.attractors import SampleSpec
from rattle.inelastic import InelasticGear
from rattle.models import Inelastic


def random_gear(rng: np.random.Generator, r: float | None = None) -> InelasticGear:
    delta = float(rng.uniform(0.1, 0.8))
    harmonics = [(int(k), float(rng.uniform(0, 0.6) / k**2), float(rng.random())) for k in (2, 5)]
    load = float(rng.choice([0.0, 1.0]))
    restitution = float(rng.uniform(0.3, 0.9)) if r is None else r
    limit = InelasticGear(delta, 0.1, 0.6, restitution, load, harmonics).quiet_limit
    beta = float(np.exp(rng.uniform(np.log(0.02), np.log(0.8))))
    return InelasticGear(delta, float(rng.uniform(0.7, 3.0)) * limit, beta, restitution, load, harmonics)


def periodic(count: int, seed: int, held: bool) -> list[tuple[InelasticGear, rattle.Attractor]]:
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        gear = random_gear(rng)
        found += [(gear, x) for x in gear.attractors(16) if x.kind == "periodic" and bool(x.contacts) == held]
    return found[:count]


def forcing(gear: InelasticGear, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """e' and g, term by term."""
    slope, force = np.zeros_like(time), np.full_like(time, gear.delta * 4 * np.pi * (1 + gear.load))
    for order, size, phase in [(1, 1.0, 0.0), *gear.harmonics]:
        turn, angle = 2 * np.pi * order, 2 * np.pi * (order * time + phase)
        slope -= gear.epsilon * size * turn * np.sin(angle)
        force -= gear.epsilon * size * turn * (turn * np.cos(angle) + gear.delta * np.sin(angle))
    return slope, force


def work_of_flight(gear: InelasticGear, begin: float, end: float, w: float) -> tuple[float, float]:
    """∫ g Φ' and ∫ δ Φ'² of a free flight that begins with velocity w, by quadrature."""
    pieces = max(1, math.ceil((end - begin) / 0.02))
    nodes, weights = np.polynomial.legendre.leggauss(20)
    edges = np.linspace(begin, end, pieces + 1)
    half = 0.5 * np.diff(edges)
    time = ((0.5 * (edges[1:] + edges[:-1]))[:, None] + half[:, None] * nodes).ravel()
    weight = (half[:, None] * weights).ravel()
    drift = 4 * np.pi * (1 + gear.load)
    slope, force = forcing(gear, time)
    first = forcing(gear, np.array([begin]))[0][0]
    velocity = drift + (w - first - drift) * np.exp(-gear.delta * (time - begin)) + slope
    return float(weight @ (force * velocity)), gear.delta * float(weight @ velocity**2)


@pytest.mark.parametrize("held", [False, True])
def test_impulses_balance(held: bool) -> None:
    for gear, x in periodic(either(12, 150), 3, held):
        found = gear.intensity(x)
        assert found.impulse == pytest.approx(2 * np.pi * gear.delta * (1 + gear.load), rel=1e-10), (gear, x)
        assert (found.impacts_plus * x.m, found.impacts_minus * x.m) == pytest.approx((x.n_plus, x.n_minus), rel=1e-12)
        assert (found.contact > 0) == held


@pytest.mark.parametrize("held", [False, True])
def test_energy_balances(held: bool) -> None:
    """Work of the force in flight is what drag and impacts take; contact does no work."""
    for gear, x in periodic(either(6, 150), 5, held):
        impacts = gear.impacts(x)
        begin, w, work, drag = x.tau, -x.v, 0.0, 0.0
        for i in range(impacts.time.size):
            done, lost = work_of_flight(gear, begin, impacts.time[i], w)
            work, drag = work + done, drag + lost
            begin, w = impacts.time[i] + impacts.duration[i], -impacts.wall[i] * impacts.departure[i]
        kept = (1 - gear.restitution**2) * gear.intensity(x).energy * x.m
        assert work == pytest.approx(drag + kept, rel=1e-7), (gear, x)


def test_impacts_are_those_of_the_brute_force() -> None:
    """Impacts above 1e-3 of motions with contact agree one by one, and so does the share of contact."""
    for gear, x in periodic(either(6, 60), 7, True):
        events = np.zeros((400_000, 4))
        rows = [(1.0, 1.0, 0.0), *gear.harmonics]
        orders, sizes, phases = (np.array([float(y) for y in column]) for column in zip(*rows, strict=True))
        numbers = gear.delta, 4 * math.pi * (1 + gear.load), gear.beta, gear.restitution, 1e-9
        n, *_ = march(x.tau, -x.v, 1, x.tau + min(x.m, 3), *numbers, orders, gear.epsilon * sizes, phases, events)
        seen = events[:n][(events[:n, 1] == IMPACT) & (events[:n, 3] > 1e-3)]
        ours = gear.impacts(x)
        fast = (ours.speed > 1e-3) & (ours.time < x.tau + min(x.m, 3) - 1e-6)
        count = min(int(fast.sum()), len(seen), 30)
        assert count > 0
        assert ours.time[fast][:count] == pytest.approx(seen[:count, 0], abs=1e-6)
        assert ours.wall[fast][:count].tolist() == seen[:count, 2].tolist()
        assert ours.speed[fast][:count] == pytest.approx(seen[:count, 3], abs=1e-4)


def test_elastic_impacts_are_those_of_the_elastic_gear() -> None:
    elastic, same = rattle.Gear(0.6, 0.089), InelasticGear(0.6, 0.089)
    for x in elastic.attractors(32):
        if x.kind == "chaotic":
            continue
        one, other = elastic.intensity(x), same.intensity(x)
        assert other.energy == pytest.approx(one.energy, rel=1e-9)
        assert (other.impacts_plus, other.impacts_minus, other.contact) == (
            one.impacts_plus,
            one.impacts_minus,
            one.contact,
        )
        lines, known = same.spectrum(x).amplitude, elastic.spectrum(x).amplitude
        assert np.abs(lines - known).max() < 1e-7 * np.abs(known).max()


def test_lines_of_the_spectrum_are_the_force_integrated() -> None:
    """Order 0 is −4πδ(1 + load); order k is −Σ of impulses and of the force in contact, by quadrature."""
    for gear, x in periodic(either(4, 40), 9, True):
        lines, impacts = gear.spectrum(x, 6.0), gear.impacts(x)
        assert lines.amplitude[0] == pytest.approx(-4 * np.pi * gear.delta * (1 + gear.load), rel=1e-9)
        nodes, weights = np.polynomial.legendre.leggauss(80)
        for order, amplitude in zip(lines.order[:: x.m], lines.amplitude[:: x.m], strict=True):
            strikes = impacts.wall * (impacts.speed + impacts.departure) * np.exp(-2j * np.pi * order * impacts.time)
            total = strikes.sum()
            for begin, wait in zip(impacts.time, impacts.duration, strict=True):
                time = begin + 0.5 * wait * (1 + nodes)
                total += 0.5 * wait * (weights * forcing(gear, time)[1] @ np.exp(-2j * np.pi * order * time))
            assert amplitude == pytest.approx(-total / x.m, abs=1e-6)


def test_tables_are_those_of_the_gear() -> None:
    model = Inelastic(0.6, 0.6, 0.3, ((3, 0.12, 0.3),))
    delta, epsilon = np.array([0.4, 0.6, 0.7]), np.array([0.1, 0.25, 0.3])
    table = model.attractors_of(delta, epsilon, SampleSpec(16))
    rattles, errors = model.intensities_of(delta, epsilon, table), model.impulse_balance_errors(delta, epsilon, table)
    assert (table.contacts > 0).any()
    for row in np.flatnonzero(table.kind == rattle.KINDS.index("periodic")):
        gear = model.gear(delta[table.cell[row]], epsilon[table.cell[row]])
        one = next(x for x in gear.attractors(16) if (x.tau, x.v) == (table.tau[row], table.v[row]))
        single = gear.intensity(one)
        for name in ("impacts_plus", "impacts_minus", "mean_speed", "largest_speed", "energy", "contact", "impulse"):
            assert getattr(rattles, name)[row] == pytest.approx(getattr(single, name), rel=1e-12)
        assert errors[row] < 1e-10


def test_sound_of_contact_is_that_of_its_strikes() -> None:
    gear, x = periodic(1, 11, True)[0]
    heard = gear.sound(x, 600.0, 0.5)
    assert np.isfinite(heard).all()
    strikes = gear.impacts(x, 5.0)
    assert np.abs(heard).max() <= (strikes.speed + strikes.departure).sum()
