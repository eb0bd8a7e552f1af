"""Labels where damping is weak, against samples that are followed on by plain iteration of the map."""

import math

import numpy as np
import pytest
from depth import either
from settles_later import COUNT, cells, watched

import rattle
from rattle.attractors.speeds import highest_sampled_speeds, parse_speed_limit

#: Once called chaotic, every sample of the first and most of the other settle.
TRANSIENT = [
    (0.0733410516250487, 0.03528153422051784, 0.03457524552375671, math.inf),
    (0.18717922356017702, 0.07148846167395238, 0.1481043145132963, math.inf),
]
CHAOTIC = (0.246, 0.11061, 0.10176)
KINDS = {name: i for i, name in enumerate(rattle.KINDS)}


@pytest.mark.parametrize("point", TRANSIENT)
def test_what_settles_within_ten_times_the_watch_is_not_called_chaotic(point):
    assert watched(point).wrong == 0


def test_chaos_was_watched_for_relaxation_times():
    table = rattle.attractors_of(*CHAOTIC, COUNT)
    assert list(table.kind) == [KINDS["chaotic"]]
    assert table.watched[0] >= 100.0 / CHAOTIC[0]
    assert table.first[0] > table.error[0] > 0


@pytest.mark.parametrize("number", [21, 38, 109])
def test_who_bounces_often_in_a_few_periods_may_be_about_to_rest(number):
    """Just below the quiet limit: once chaotic by thousands of impacts in a few periods, and most settle later."""
    chance = np.random.default_rng(5)
    delta, share = chance.uniform(0.4, 1.0, 400)[number], chance.uniform(0.98, 1.0, 400)[number]
    assert watched((delta, share * rattle.quiet_limit(delta), 0.6, math.inf)).wrong == 0


#: Just below the quiet limit: all samples rest within 600,000 impacts.
AT_THE_LIMIT = (0.6252706847775731, 0.19775731219380202, 0.5009509383945855)


@pytest.mark.parametrize("count", [1, 2, 4, 8, 16])
def test_a_small_count_is_no_reason_to_call_a_transient_chaos(count):
    gear = rattle.Gear(*AT_THE_LIMIT)
    for v_max in (None, "natural"):
        assert not [each for each in gear.attractors(count, v_max) if each.kind == "chaotic"]


@pytest.mark.parametrize("count", [1, 2, 4, 8, 16])
def test_chaos_is_found_by_few_samples_too(count):
    """There are cells with and without quiet running, observed as long as with many samples."""
    for point in ((0.6, 0.1), (0.762, 0.0968), (0.5, 0.2)):
        many = rattle.Gear(*point).attractors(64)
        few = rattle.Gear(*point).attractors(count)
        assert {each.kind for each in few} <= {each.kind for each in many}
    (chaos,) = rattle.Gear(0.45, 0.25).attractors(count)
    assert (chaos.kind, chaos.fraction) == ("chaotic", 1.0)


@pytest.mark.parametrize("count", either([4], [2, 4, 8, 16]))
def test_few_samples_are_wrong_about_chaos_as_rarely_as_many(count):
    """Random cells just below the quiet limit; without states beside the samples a third settle later."""
    law = list(zip(*(map(float, each) for each in cells("limit", 240, 6)), strict=True))
    found = [watched(point, count) for point in law]
    chaotic, wrong = (sum(getattr(each, name) for each in found) for name in ("chaotic", "wrong"))
    assert chaotic > 0
    assert wrong <= 0.1 * chaotic


@pytest.mark.parametrize("budget", [1, 100, 1000])
def test_a_budget_leaves_samples_undecided_and_never_chaotic(budget):
    table = rattle.attractors_of(*CHAOTIC, COUNT, budget=budget)
    assert list(table.kind) == [KINDS["undecided"]]
    assert table.impacts[0] <= COUNT * (budget + 40)  # a lane may make some flights too many
    assert 0 < table.watched[0] < 2000.0


def test_a_settled_cell_was_not_watched():
    assert np.isnan(rattle.attractors_of(0.6, 0.0615, 0.6, 16).watched).all()


def test_an_orbit_that_no_sample_finds_is_listed_with_a_bound():
    """A state that rests soon, and C of closed form beside it."""
    (c,) = [orbit for orbit in rattle.Gear(0.6, 0.0615).orbits() if orbit.stable]
    quiet, missed = rattle.Gear(0.6, 0.0615).attractors(4, v_max=0.01)
    assert (quiet.kind, quiet.fraction) == ("quiet", 1.0)
    assert (missed.kind, missed.fraction, missed.v) == ("periodic", 0.0, pytest.approx(c.v))
    assert missed.fraction_interval == (0.0, float(rattle.wilson_interval(0, 4)[1]))
    assert missed.lyapunov == (pytest.approx(-0.3), pytest.approx(-0.3))


def test_natural_speeds():
    point = (np.array([x]) for x in (0.6, 0.1, 0.6))
    assert highest_sampled_speeds("natural", *point)[0] == pytest.approx(7.0, rel=0.002)
    small = [np.array([x]) for x in (0.002, 0.0005, 0.001)]
    assert highest_sampled_speeds(None, *small)[0] == pytest.approx(1.5 * np.sqrt(16 * np.pi * 2e-6) + np.pi * 1e-3)
    assert highest_sampled_speeds(7.0, *small)[0] == 7.0


@pytest.mark.parametrize("v_max", ["fast", "", -1.0, np.nan, True])
def test_no_speed(v_max):
    with pytest.raises(rattle.ParameterError, match="v_max"):
        rattle.Gear(0.6, 0.1).attractors(4, v_max=v_max)


def test_a_speed_as_it_is_typed():
    assert [parse_speed_limit(text) for text in ("7", " natural ", "", None)] == [7.0, "natural", None, None]
