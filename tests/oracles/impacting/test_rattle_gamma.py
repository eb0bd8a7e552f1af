"""The grazing curve Γ against 40 digits, and against where the impact map begins to touch Σ⁻."""

import numpy as np
import pytest
from high_precision import Flight
from mpmath import mpf

import rattle

POINTS = [(0.6, 0.1, 0.6), (0.6, 0.0, 0.6), (0.45, 0.12, 0.2), (1.0, 0.3, 1.0), (0.6, 0.25, 0.6), (0.5, 0.29, 0.3)]


@pytest.mark.parametrize("point", POINTS)
def test_points_touch_the_wall_in_40_digits(point):
    pieces = rattle.Gear(*point).gamma()
    assert pieces
    for piece in pieces:
        for i in {*range(0, piece.tau.size, max(1, piece.tau.size // 12)), piece.tau.size - 1}:
            flight = Flight(1, piece.tau[i], -piece.v[i], *point)
            lowest = mpf(piece.touch[i]) - mpf(piece.tau[i])
            assert abs(flight.position(lowest) + flight.beta) < 1e-10
            assert abs(flight.velocity(lowest)) < 1e-10
            before = [flight.position(lowest * k / 60) for k in range(1, 60)]
            assert max(before) < flight.beta
            assert min(before) > -flight.beta


@pytest.mark.parametrize("point", POINTS)
def test_pieces_are_in_order_and_dense(point):
    for spacing in (0.1, 0.02):
        for piece in rattle.Gear(*point).gamma(spacing):
            assert (np.diff(piece.touch) > 0).all()
            assert (np.hypot(np.diff(piece.tau), np.diff(piece.v)) <= spacing).all()
            if piece.closed:
                assert piece.tau[-1] - piece.tau[0] == pytest.approx(1.0, abs=1e-12)
                assert piece.v[-1] == pytest.approx(piece.v[0], abs=1e-12)


@pytest.mark.parametrize("point", POINTS)
def test_the_map_begins_to_touch_the_wall_at_gamma_only(point):
    """Up any column of the plane, the flight's impacts on Σ⁻ change from none to some exactly where Γ lies."""
    gear = rattle.Gear(*point)
    pieces = gear.gamma(0.01)
    tau, v = (np.concatenate([getattr(p, name) for p in pieces]) for name in ("tau", "v"))
    speeds = np.linspace(0.02, 8.0, 400)
    for phase in (0.05, 0.31, 0.52, 0.77, 0.9):
        bounces = gear.iterate(phase, speeds, 1).n_minus
        for i in np.flatnonzero((bounces[1:] > 0) != (bounces[:-1] > 0)):
            low, high = speeds[i], speeds[i + 1]
            for _ in range(40):
                middle = 0.5 * (low + high)
                same = (gear.impact(phase, middle).n_minus > 0) == (bounces[i] > 0)
                low, high = (middle, high) if same else (low, middle)
            distance = np.hypot((tau - phase + 0.5) % 1 - 0.5, v - low).min()
            slow_touch = gear.first_impact(1, phase, -high).flight_time  # or the flight grazes Σ⁺, which is not Γ
            jump = abs(slow_touch - gear.first_impact(1, phase, -low).flight_time) > 0.01
            assert distance < 0.011 or (jump and gear.epsilon > gear.quiet_limit)
    if gear.epsilon < gear.quiet_limit:
        assert len(pieces) == 1
        assert pieces[0].closed
