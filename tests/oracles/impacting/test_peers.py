"""The impact map against integrators that know nothing of the closed form: scipy's, and heyoka's where installed."""

import numpy as np
import pytest
from bench import peers

import rattle

COUNT = 40
AGREEMENT = 1e-9


@pytest.fixture(scope="module", params=["scipy", "heyoka"])
def run(request):
    pytest.importorskip(request.param)
    return peers.PEERS[request.param][0]()


def test_one_step_of_the_map_over_the_plane(run):
    phase, speed, compared, lost = peers.differences(run, peers.random_starts(COUNT, seed=2009))
    assert compared == COUNT
    assert lost <= 2
    assert phase < AGREEMENT
    assert speed < AGREEMENT


def test_small_bounces_are_not_missed(run):
    """Flights so short that an integrator's own first step would contain all of them."""
    some = peers.random_starts(COUNT, seed=3)
    starts = peers.Starts(some.tau, some.v * 1e-2, some.delta, some.epsilon * 0.1)
    phase, speed, _, lost = peers.differences(run, starts)
    assert lost == 0
    assert phase < AGREEMENT
    assert speed < AGREEMENT


def test_several_steps_of_the_map(run):
    starts = peers.workload(12)
    theirs, ours = run(starts, 4), rattle.Gear(0.6, 0.1).iterate(starts.tau, starts.v, 4)
    assert (theirs.n_plus == 4).all()
    np.testing.assert_array_equal(theirs.n_minus, ours.n_minus)
    np.testing.assert_allclose((theirs.tau - ours.tau + 0.5) % 1.0, 0.5, rtol=0, atol=AGREEMENT)
    np.testing.assert_allclose(theirs.v, ours.v, rtol=AGREEMENT, atol=0)


def test_flights_that_do_not_end_are_lost(run, monkeypatch):
    monkeypatch.setattr(peers, "PATIENCE", 1e-3)
    assert peers.differences(run, peers.random_starts(COUNT)) == (0.0, 0.0, COUNT, COUNT)


def test_lost_trajectories_are_counted_and_only_they_are_left_out():
    def clumsy(starts, n):
        rows = zip(starts.tau, starts.v, starts.delta, starts.epsilon, strict=True)
        done = [rattle.Gear(delta, epsilon).impact(tau, v) for tau, v, delta, epsilon in rows]
        tau, v, n_minus = (np.array([getattr(one, name) for one in done]) for name in ("tau", "v", "n_minus"))
        n_plus = np.full(tau.size, n)
        n_plus[0], tau[0] = 0, 0.123  # stopped
        n_minus[1], v[1] = n_minus[1] + 1, 99.0  # another sequence of walls
        tau[2], v[3] = (tau[2] + 0.9999) % 1.0, v[3] * 1.01  # merely wrong
        return rattle.Iterates(tau, v, n_plus, n_minus)

    phase, speed, compared, lost = peers.differences(clumsy, peers.random_starts(10))
    assert (compared, lost) == (10, 2)
    assert phase == pytest.approx(1e-4)
    assert speed == pytest.approx(1e-2)


def test_a_peer_that_is_not_installed_is_named_and_skipped(monkeypatch):
    monkeypatch.setattr(peers, "find_spec", lambda _name: None)
    assert list(peers.peers()) == []
    assert peers.missing() == dict.fromkeys(peers.PEERS, "pip install 'gear-rattle[peers]'")


def test_a_measured_peer_says_what_it_is(monkeypatch):
    monkeypatch.setattr(peers, "PEERS", {"scipy": (peers.Scipy, 2, 2)})
    monkeypatch.setattr(peers, "REPEATS", 1)
    (peer,) = peers.peers(compared=3)
    assert (peer.name, peer.compared, peer.lost) == ("scipy", 3, 0)
    assert peer.nanoseconds > 0
    assert peer.rattle_nanoseconds > 0
    assert peer.ratio == peer.nanoseconds / peer.rattle_nanoseconds
