"""Own samples: in a box, of a density, and where given states go."""

import numpy as np
import pytest

import rattle
from rattle import stiff

GEAR = rattle.Gear(0.6, 0.0615)


def test_a_box_is_filled_evenly() -> None:
    tau, v = rattle.sampled_states(4096, (1.0, 3.0), (0.25, 0.75))
    assert 0.25 <= tau.min() < 0.251
    assert 0.749 < tau.max() <= 0.75
    assert 1.0 <= v.min() < 1.001
    assert 2.999 < v.max() <= 3.0
    counts = np.histogram2d(tau, v, 16, ((0.25, 0.75), (1.0, 3.0)))[0]
    assert abs(counts - 16).max() <= 4  # a lattice of 256 boxes: at random it would be 13 or so


def test_a_density_is_followed() -> None:
    """The moments of v² over (0, 2), and of 1 + cos 2πτ, are compared."""
    tau, v = rattle.sampled_states(1 << 14, (0.0, 2.0), density=lambda tau, v: (1 + np.cos(2 * np.pi * tau)) * v**2)
    assert v.mean() == pytest.approx(1.5, abs=1e-3)
    assert (v**2).mean() == pytest.approx(12.0 / 5.0, abs=3e-3)
    assert np.cos(2 * np.pi * tau).mean() == pytest.approx(0.5, abs=1e-3)
    inside = rattle.sampled_states(512, (0.0, 2.0), density=lambda tau, v: (abs(tau - 0.5) < 0.1) & (v > 1.0))
    assert (abs(inside[0] - 0.5) < 0.1 + 1 / 512).all()
    assert (inside[1] > 1.0 - 2 / 512).all()


def test_samples_are_those_of_their_seed() -> None:
    first, again, other = (rattle.sampled_states(64, (0.0, 7.0), seed=seed) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"count": 0, "v": (0, 1)}, "count must be an integer"),
        ({"count": 4, "v": (1, 1)}, "v must be"),
        ({"count": 4, "v": (-1, 1)}, "v must be"),
        ({"count": 4, "v": (0, 1), "tau": (0.5, 1.5)}, "tau must be"),
        ({"count": 4, "v": (0, 1), "density": lambda tau, v: tau - v - 1}, "density must be finite, nowhere negative"),
        ({"count": 4, "v": (0, 1), "density": lambda tau, v: 0 * tau * v}, "somewhere above 0"),
    ],
)
def test_what_is_no_sample_is_refused(options, message) -> None:
    with pytest.raises(rattle.ParameterError, match=message):
        rattle.sampled_states(**options)


@pytest.mark.parametrize("gear", [GEAR, stiff.StiffGear(0.6, 0.0615, 0.6, 1e4)])
def test_states_go_where_the_sample_says(gear) -> None:
    """Known ends: states on C, near rest, and on either side of the saddle A along its unstable direction."""
    orbits = {each.name: each for each in gear.orbits()}
    a, c = orbits["A"], orbits["C"]
    found = gear.reached([[c.tau, 0.5], [a.tau, a.tau]], [[c.v, 0.02], [a.v * 0.98, a.v * 1.02]])
    assert found.which.shape == found.impacts.shape == (2, 2)
    kinds = [[found.attractors[i].kind for i in row] for row in found.which]
    assert kinds[0] == ["periodic", "quiet"]
    assert set(kinds[1]) == {"periodic", "quiet"}
    assert [each.fraction for each in found.attractors] == [0.5, 0.5]
    assert (found.impacts >= 0).all()


def test_states_are_told_as_those_of_the_sample() -> None:
    tau, v = rattle.sampled_states(256, (0.0, 7.0))
    found = GEAR.reached(tau, v)
    direct = GEAR.basins(16, method="direct")
    again = GEAR.reached(*np.meshgrid(direct.tau, direct.v))
    assert [(x.kind, x.m) for x in again.attractors] == [(x.kind, x.m) for x in direct.attractors]
    assert np.array_equal(again.which, direct.labels)
    assert sum(each.fraction for each in found.attractors) == 1.0


def test_attractors_of_a_box() -> None:
    """Around C all samples go to it; the halves of the plane of states have the basins of the whole together."""
    c = next(each for each in GEAR.orbits() if each.name == "C")
    near = rattle.attractors_of(
        0.6, 0.0615, count=32, v_max=c.v + 0.02, tau=(c.tau - 0.01, c.tau + 0.01), v_min=c.v - 0.02
    )
    assert (near.samples[near.samples > 0].tolist(), near.m[near.samples > 0].tolist()) == ([32], [1])
    quiet = [
        rattle.attractors_of(0.6, 0.0615, count=2048, tau=tau).samples[0] / 2048
        for tau in ((0.0, 0.5), (0.5, 1.0), (0.0, 1.0))
    ]
    assert quiet[0] != quiet[1]
    assert 0.5 * (quiet[0] + quiet[1]) == pytest.approx(quiet[2], abs=0.004)
    with pytest.raises(rattle.ParameterError, match="v must be"):
        rattle.attractors_of(0.6, 0.0615, v_min=7.0)


@pytest.mark.parametrize(
    ("tau", "v", "message"),
    [
        ([0.1, 0.2], [1.0, 2.0, 3.0], "broadcast"),
        (np.nan, 1.0, "tau must be finite"),
        (0.1, 0.0, "v must be finite and greater than 0"),
        ([], [], "give at least one state"),
    ],
)
def test_what_are_no_states_is_refused(tau, v, message) -> None:
    with pytest.raises(rattle.ParameterError, match=message):
        GEAR.reached(tau, v)


@pytest.mark.parametrize("method", ["direct", "cells", "refined"])
@pytest.mark.parametrize("gear", [GEAR, stiff.StiffGear(0.6, 0.0615, 0.6, 1e4)])
def test_a_zoomed_plane_is_a_part_of_the_whole(gear, method) -> None:
    """The same cells, followed directly, of the whole plane and of its part."""
    whole = gear.basins(32, 8.0, "direct")
    part = gear.basins(16, 8.0, method, tau=(0.25, 0.75), v=(2.0, 6.0))
    assert np.allclose(part.tau, whole.tau[8:24], atol=1e-15)
    assert np.allclose(part.v, whole.v[8:24])
    names = [[(x.kind, x.m) for x in each.attractors] for each in (part, whole)]
    label = np.array([names[1].index(name) for name in names[0]])
    differ = label[part.labels] != whole.labels[8:24, 8:24]
    assert differ.mean() <= {"direct": 0.0, "refined": 0.01, "cells": 0.1}[method]
    assert tuple(part.box) == (0.25, 0.75, 2.0, 6.0)
    assert part.v_max == 6.0


def test_a_box_that_is_none_is_refused() -> None:
    with pytest.raises(rattle.ParameterError, match="tau must be"):
        GEAR.basins(8, tau=(0.5, 0.5))
    with pytest.raises(rattle.ParameterError, match="v must be"):
        GEAR.basins(8, v=(3.0, 1.0))
