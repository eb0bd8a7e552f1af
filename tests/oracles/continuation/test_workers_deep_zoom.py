"""Deep zoom around COD22 against 40 digits: region labels stay right in windows 1e-9 wide and beside every curve."""

import curves_high_precision as exact
import numpy as np
import pytest
from mpmath import mp, mpf

import rattle
from gear_rattle.workers import SurveyRequest, Window, compute_window_part, request_for_window

REQUEST = SurveyRequest(delta={"start": 0.4, "stop": 1.0, "num": 2}, epsilon={"start": 0.01, "stop": 0.3, "num": 2})
ROUNDING = 2e-15  # in ε: labels are right wherever double precision tells which side of a curve a cell is on
NOTHING, A_AND_C, A_AND_D = 1, 2, 5  # regions I, II, V


@pytest.fixture(scope="module")
def cod22() -> exact.Known:
    return exact.known_codimension_two("COD22", 0.6)


def sn1(delta: float) -> mpf:
    return abs(2 - mpf(delta) * mp.coth(mpf(delta) / 2))


@pytest.mark.parametrize(("right", "up"), [(0.0, 0.0), (0.4, 0.1), (-0.3, -0.2)])
def test_a_window_1e_9_wide(cod22: exact.Known, right: float, up: float) -> None:
    """Here SN1, G1 and G2 are one curve, to 1e-18: below it there is no orbit (I), above it A and D (V)."""
    width = 1e-9
    delta, epsilon = float(cod22.delta) + right * width, float(cod22.epsilon) + up * width
    window = Window((delta - width / 2, delta + width / 2), (epsilon - width / 2, epsilon + width / 2))
    survey = request_for_window(REQUEST, window, (65, 65))
    delta, epsilon = survey.delta.values(), survey.epsilon.values()
    assert survey.shape == (65, 65)
    assert np.ptp(delta) == pytest.approx(width, rel=1e-6)
    labels = compute_window_part(survey, "region", 0, delta, epsilon).values
    above = np.array([[float(mpf(e) - sn1(d)) for d in delta] for e in epsilon])
    clear = np.abs(above) > ROUNDING
    assert clear.sum() >= clear.size - 2
    np.testing.assert_array_equal(labels[clear], np.where(above > 0, A_AND_D, NOTHING)[clear])
    assert {NOTHING, A_AND_D} <= set(labels.ravel().tolist())


@pytest.mark.parametrize("offset", [-1e-4, -1e-5, -4e-10, 4e-10, 1e-4])
def test_both_sides_of_each_curve(cod22: exact.Known, offset: float) -> None:
    """I, II, V across SN1 and G1 before COD22, as far as they can be told apart; I, V across G2 after it."""
    delta = float(cod22.delta) + offset
    names = ("SN1", "G1") if offset < 0 else ("G2",)
    at = [exact.known_points(name, delta, 0.6, float(cod22.epsilon) + 1e-3)[-1].epsilon for name in names]
    if offset < 0:
        assert abs(at[0] - sn1(delta)) < mpf(10) ** -30
        assert 0 < at[1] - at[0] < offset**2 * 4
    for number, curve in enumerate(at):
        low, high = (rattle.Gear(delta, float(curve + side * ROUNDING)).region() for side in (-1, 1))
        apart = at[-1] - at[0] > 2 * ROUNDING
        assert low == (A_AND_C if number and apart else NOTHING)
        assert high == (A_AND_C if not number and apart else A_AND_D)
