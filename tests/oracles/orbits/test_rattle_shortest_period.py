"""A periodic motion is given with its least period, whatever number of impacts was asked for, of either gear."""

import pytest

import rattle
from rattle.stiff import StiffGear

GEARS = {"impacting": rattle.Gear(0.6, 0.089), "stiff": StiffGear(0.6, 0.089, kappa=1e5)}


@pytest.mark.parametrize("name", GEARS)
@pytest.mark.parametrize("times", [2, 3, 4, 6])
def test_a_motion_several_times_over_is_given_once(name: str, times: int) -> None:
    gear = GEARS[name]
    motions = [(orbit.tau, orbit.v, orbit.n_plus) for orbit in gear.orbits()]
    longer = next(each for each in gear.attractors(64) if each.kind == "periodic" and each.m > 1)
    for tau, v, n_plus in [*motions, (longer.tau, longer.v, longer.n_plus)]:
        once, again = gear.orbit(tau, v, n_plus), gear.orbit(tau, v, times * n_plus)
        assert again.label == once.label
        assert again.label[1] == n_plus
        assert again.times == pytest.approx(once.times, abs=1e-9)
        assert again.speeds == pytest.approx(once.speeds, abs=1e-9)
        assert again.multipliers == pytest.approx(once.multipliers, rel=1e-6)
        assert again.stable == once.stable


def test_a_motion_that_has_just_doubled_keeps_its_period() -> None:
    """Both halves are close together there, and D itself is no longer stable."""
    start = rattle.Gear(0.6, 0.077)
    doubled = next(each for each in start.attractors() if (each.m, each.n_plus, each.n_minus) == (2, 2, 2))
    branch = rattle.branch(start.orbit(doubled.tau, doubled.v, 2), "epsilon", (0.0761, 0.077))
    flip = rattle.curves.trace("PD1", delta=(0.55, 0.65)).at(0.6)[0]
    near = [branch.orbit(i) for i in range(len(branch.epsilon)) if flip + 1e-6 < branch.epsilon[i] < 0.077]
    assert len(near) > 3
    assert min(orbit.epsilon for orbit in near) < flip + 1e-4
    for orbit in near:
        gear = rattle.Gear(0.6, orbit.epsilon)
        assert gear.orbit(orbit.tau, orbit.v, 2).label == (2, 2, 2)
        assert gear.orbit(orbit.tau, orbit.v, 4).label == (2, 2, 2)
        (d,) = [each for each in gear.orbits() if each.name == "D"]
        assert gear.orbit(d.tau, d.v, 2).label == (1, 1, 1)
        assert not gear.orbit(d.tau, d.v, 2).stable


def test_proofs_and_branches_of_a_motion_asked_for_twice_over_are_of_the_motion() -> None:
    gear = GEARS["impacting"]
    (c,) = [each for each in gear.orbits() if each.name == "C"]
    orbit = gear.orbit(c.tau, c.v, 2)
    assert rattle.certify(orbit).label == (1, 1, 0)
    assert rattle.branch(orbit, "epsilon", (0.08, 0.1)).label == (1, 1, 0)
