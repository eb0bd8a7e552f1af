"""Attractors along paths: where they begin and end against closed forms, curves, and the families of grids."""

import numpy as np
import pytest
from depth import deep

import rattle
from rattle import stiff
from rattle.resilience.causes import TrackedOrbit, find_orbit_end
from rattle.resilience.path import GlobalContinuation

QUIET = ("quiet", 0, 0, 0)
C, D = ("periodic", 1, 1, 0), ("periodic", 1, 1, 1)


def number_of(found: GlobalContinuation, label: tuple[str, int, int, int]) -> int:
    return next(n for n in found.families if found.label(n) == label)


def changes_of(found: GlobalContinuation, label: tuple[str, int, int, int]) -> list[tuple[bool, str, float]]:
    """Return for each family of a label whether it begins or ends, the cause, and ε there."""
    at = np.arange(len(found.parameters))
    return [
        (each.begins, each.cause, float(np.interp(0.5 * (each.low + each.high), at, found.parameters[:, 1])))
        for each in found.changes
        if found.label(each.family) == label
    ]


@pytest.fixture(scope="module")
def births() -> GlobalContinuation:
    return rattle.global_continuation([(0.6, 0.056), (0.6, 0.0778)], count=16, steps=9)


def test_c_and_d_begin_and_end_where_the_curves_are(births: GlobalContinuation) -> None:
    assert changes_of(births, C) == [(True, "saddle-node", pytest.approx(0.0596430582, abs=2e-9))]
    pd1 = rattle.curves.trace("PD1", 0.6, (0.55, 0.65), (0.05, 0.1)).at(delta=0.6)[0]
    sn2 = rattle.curves.trace("SN2", 0.6, (0.55, 0.65), (0.05, 0.1)).at(delta=0.6)[0]
    assert changes_of(births, D) == [
        (True, "saddle-node", pytest.approx(sn2, abs=2e-9)),
        (False, "flip", pytest.approx(pd1, abs=2e-9)),
    ]
    assert (sn2, pd1) == pytest.approx((0.06874679, 0.07615571), abs=1e-8)
    lost = next(each for each in births.changes if each.cause == "flip" and not each.begins)
    assert births.label(lost.other) == ("periodic", 2, 2, 2)
    assert changes_of(births, ("periodic", 2, 2, 2)) == [(True, "flip", pytest.approx(pd1, abs=2e-9))]


def test_families_are_those_of_a_grid_of_one_column() -> None:
    epsilon = np.linspace(0.085, 0.112, 24)
    path = rattle.global_continuation(np.column_stack([np.full(24, 0.6), epsilon]), count=16, causes=False)
    grid = rattle.families_of([0.6], epsilon, count=16)
    for name, mine in vars(path.attractors).items():
        assert np.array_equal(mine, getattr(grid.attractors, name), equal_nan=True), name
    assert np.array_equal(path.family, grid.family)
    for n in path.families:
        assert np.array_equal(path.fractions(n), grid.fractions(n)[:, 0], equal_nan=True)
        low, high = path.fraction_intervals(n)
        there = np.isfinite(path.fractions(n))
        assert (low[there] <= path.fractions(n)[there]).all()
        assert (high[there] > path.fractions(n)[there]).all() or path.fractions(n).max() == 1.0
    assert np.array_equal(np.bincount(path.which.ravel(), minlength=path.family.size), path.attractors.samples)
    assert not path.changes


def test_c_ends_at_a_graze() -> None:
    found = rattle.global_continuation([(0.6, 0.14), (0.6, 0.149)], count=16, steps=3)
    g1 = float(rattle.grazing("G1", 0.6).epsilon)
    assert changes_of(found, C) == [(False, "graze", pytest.approx(g1, abs=2e-9))]


@deep
def test_causes_are_the_events_of_the_diagram() -> None:
    """Pseudo-arclength continuation of the branches meets the same saddle-nodes, flips and grazes."""
    ends = (0.6, 0.12), (0.6, 0.16)
    found = rattle.global_continuation(ends, count=16, steps=8)
    diagram = rattle.diagram(*ends, steps=8, count=16)
    kinds, compared = {"saddle-node": "SN", "flip": "PD", "graze": "GR"}, set()
    for each in found.changes:
        kind, _m, plus, minus = found.label(each.family)
        if kind == "periodic" and plus + minus <= 4 and each.cause in kinds:
            epsilon = np.interp(0.5 * (each.low + each.high), np.arange(9), found.parameters[:, 1])
            events = [event.epsilon for event in diagram.events if event.kind == kinds[each.cause]]
            assert np.abs(np.array(events) - epsilon).min() < 1e-8, (each, found.label(each.family))
            compared.add(each.cause)
    assert compared == kinds.keys()


def test_half_backlash_is_a_parameter_too() -> None:
    """C ends where the G1 of a β has the ε of the path."""
    found = rattle.global_continuation([(0.6, 0.08, 0.6), (0.6, 0.08, 0.4)], count=16, steps=4)
    lost = next(each for each in found.changes if found.label(each.family) == C)
    beta = float(np.interp(0.5 * (lost.low + lost.high), np.arange(5), found.parameters[:, 2]))
    assert (lost.begins, lost.cause) == (False, "graze")
    assert float(rattle.grazing("G1", 0.6, beta).epsilon) == pytest.approx(0.08, abs=1e-8)


def test_chaos_ends_in_its_boundary_crisis() -> None:
    # Not within 0.0003 of the crisis: there what is left of the attractor lives so long that it may be called one.
    found = rattle.global_continuation([(0.6, 0.1095), (0.6, 0.1119)], count=32, steps=4)
    ends = [each for each in found.changes if found.label(each.family)[0] == "chaotic" and not each.begins]
    last = max(ends, key=lambda each: each.step)
    assert last.cause == "crisis"
    epsilon = found.parameters[:, 1]
    assert epsilon[last.step] < 0.11088676 < epsilon[last.step + 1]
    assert last.other in (number_of(found, QUIET), number_of(found, C))


def test_quiet_motion_ends_at_its_limit() -> None:
    found = rattle.global_continuation([(0.6, 0.184), (0.6, 0.194)], count=16, steps=1)
    limit = [each for each in found.changes if each.family == 0]
    assert [(each.begins, each.cause) for each in limit] == [(False, "quiet limit")]
    assert found.parameters[limit[0].step, 1] < rattle.quiet_limit(0.6) < found.parameters[limit[0].step + 1, 1]


def test_a_family_that_no_sample_told_is_no_end() -> None:
    """Two samples miss C at most steps, but its neighbours know it, and it ends at its birth only."""
    found = rattle.global_continuation([(0.6, 0.0785), (0.6, 0.058)], count=2, steps=12)
    c = number_of(found, C)
    fractions, (_low, high) = found.fractions(c), found.fraction_intervals(c)
    assert (fractions == 0.0).any()
    assert (high[fractions == 0.0] > 0.6).all()
    assert [(cause, begins) for begins, cause, _ in changes_of(found, C)] == [("saddle-node", False)]


def test_the_stiff_gear_has_paths_too() -> None:
    """Along κ as well: C is born where the saddle-node of its stiffness is."""
    found = rattle.global_continuation([(0.6, 0.056), (0.6, 0.06)], count=16, steps=3, kappa=1e4)
    born = next(each for each in found.changes if found.label(each.family) == C and each.begins)
    epsilon = float(np.interp(0.5 * (born.low + born.high), np.arange(4), found.parameters[:, 1]))
    assert born.cause == "saddle-node"
    assert epsilon == pytest.approx(stiff.StiffGear(0.6, 0.0, 0.6, 1e4).sn1, abs=1e-8)
    softer = rattle.global_continuation([(0.6, 0.07, 0.6, 1e4), (0.6, 0.07, 0.6, 3e3)], count=32, steps=2)
    assert np.isfinite(softer.fractions(number_of(softer, C))).all()
    assert softer.parameters[1, 3] == 6.5e3


def test_a_step_that_is_too_long_is_halved() -> None:
    """From just above C's birth: one step is too long for Newton's method; halved, or with more, it is one family."""
    path = [(0.45, 0.0345), (0.45, 0.09)]
    halved = rattle.global_continuation(path, count=64, steps=1)
    whole = rattle.global_continuation(path, count=16, steps=20)
    assert not changes_of(whole, C)
    assert not changes_of(halved, C)
    assert not [each for each in halved.changes if each.cause == "continues"]


def test_a_motion_of_very_many_impacts_is_not_followed() -> None:
    """P(1,107,0), of which each step would take half a second."""
    long = TrackedOrbit((1, 107, 0), 0.48698548922191587, 0.039303353146466116)
    end = find_orbit_end(np.array([0.57333333, 0.178, 0.6]), np.array([0.58, 0.176, 0.6]), long)
    assert (end.cause, end.low, end.high) == ("unknown", 0.0, 1.0)


def test_own_states_are_followed_at_every_step() -> None:
    """States of a box in C's basin, where C is: all of them go to it."""
    gear = rattle.Gear(0.6, 0.0625)
    c = next(each for each in gear.orbits() if each.name == "C")
    box = (c.v - 0.02, c.v + 0.02), (c.tau - 0.005, c.tau + 0.005)
    states = rattle.sampled_states(16, *box)
    found = rattle.global_continuation([(0.6, 0.056), (0.6, 0.0625)], steps=1, causes=False, states=states)
    assert found.count == 16
    assert found.fractions(number_of(found, C))[1] == 1.0
    assert found.fractions(number_of(found, QUIET)).tolist()[0] == 1.0
    assert rattle.tipping(gear, rattle.Gear(0.6, 0.056), states=states).number.tolist() == [[16]]
    assert rattle.convergence(gear, states=states, within=0.05).time.max() < 5.0


class Fastest:
    """The largest speed that a sample departs with."""

    def begin(self, tau: np.ndarray, v: np.ndarray) -> None:  # noqa: ARG002
        self.v = v.copy()

    def add(self, sample: np.ndarray, tau: np.ndarray, v: np.ndarray, time: np.ndarray) -> None:  # noqa: ARG002
        self.v[sample] = np.maximum(self.v[sample], v)

    def values(self) -> np.ndarray:
        return self.v


@deep
def test_own_quantities_are_gathered() -> None:
    found = rattle.global_continuation(
        [(0.6, 0.0615), (0.6, 0.0625)], count=8, steps=1, causes=False, quantities={"fastest": Fastest}, periods=20.0
    )
    assert found.quantities["fastest"].shape == (2, 8)
    gear = rattle.Gear(0.6, 0.0615)
    own = rattle.accumulated(gear, *rattle.sampled_states(5, (0.0, 7.0)), Fastest(), 20.0)
    tau, v = rattle.sampled_states(5, (0.0, 7.0))
    for i in range(5):
        motion = gear.trajectory(tau[i], v[i], 20.0, 2)
        on_plus = motion.impact_speed[motion.impact_wall > 0]
        assert own[i] == pytest.approx(max(v[i], on_plus.max(initial=0.0)), abs=1e-9)
    n = number_of(found, QUIET)
    mean, error = found.means("fastest", n)
    mine = found.family[found.which] == n
    for i in range(2):
        values = found.quantities["fastest"][i][mine[i]]
        assert mean[i] == pytest.approx(values.mean())
        assert error[i] == pytest.approx(values.std(ddof=1) / np.sqrt(values.size))


@pytest.mark.parametrize(
    ("path", "options", "message"),
    [
        ([(0.6, 0.1)], {}, "path must have a row for each"),
        ([(0.6,), (0.7,)], {}, "path must have a row for each"),
        ([(0.6, 0.1), (0.6, 0.1)], {}, "neighbouring points of the path must differ"),
        ([(0.6, 0.1), (0.0, 0.1)], {}, "delta must be greater than 0"),
        ([(0.6, 0.1), (0.6, 0.2)], {"steps": 0}, "steps must be an integer"),
        ([(0.6, 0.1), (0.6, 0.2)], {"count": 0}, "count must be an integer"),
    ],
)
def test_what_is_no_path_is_refused(path, options, message) -> None:
    with pytest.raises(rattle.ParameterError, match=message):
        rattle.global_continuation(path, **options)


def test_a_family_that_is_not_there_is_refused(births: GlobalContinuation) -> None:
    with pytest.raises(rattle.ParameterError, match="there is no family 99"):
        births.fractions(99)
