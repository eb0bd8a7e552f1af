"""What an inelastic gear refuses: each sentence says what is allowed and what to do."""

import math
import pickle

import pytest

import rattle
from rattle.inelastic import InelasticGear
from rattle.models import Inelastic, model_of


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"restitution": 0.0}, "restitution must be greater than 0, got 0.0"),
        ({"restitution": -0.5}, "restitution must be greater than 0"),
        ({"restitution": 1.2}, "restitution must be at most 1, got 1.2: 1 is an elastic impact"),
        ({"restitution": math.nan}, "restitution must be finite"),
        ({"restitution": "0.9"}, "restitution must be real numbers"),
        ({"load": -0.1}, "load must not be negative"),
        ({"load": math.nan}, "load must be finite"),
        ({"harmonics": [(0, 0.1, 0.0)]}, "a harmonic of order 0 is a constant and has no effect: leave it out"),
        ({"harmonics": [(1, 0.1, 0.0)]}, "is the eccentricity itself: give its amplitude as epsilon"),
        ({"harmonics": [(-2, 0.1, 0.0)]}, "must be at least 2"),
        ({"harmonics": [(2.5, 0.1, 0.0)]}, "must be an integer, got 2.5"),
        ({"harmonics": [(5000, 0.1, 0.0)]}, "must be at most 1000"),
        ({"harmonics": [(3, 0.1, 0.0), (3, 0.2, 0.0)]}, "order 3 is given twice: combine both into one harmonic"),
        ({"harmonics": [(3, -0.1, 0.0)]}, "must not be negative: add half a turn to its phase"),
        ({"harmonics": [(3, math.inf, 0.0)]}, "the amplitude of order 3 must be finite"),
        ({"harmonics": [(3, 0.1, math.nan)]}, "the phase of order 3 must be finite"),
        ({"harmonics": [(3, 0.1)]}, "harmonics must be a list of \\(order, amplitude, phase\\)"),
        ({"harmonics": 3}, "harmonics must be a list"),
        ({"harmonics": [(k, 0.1, 0.0) for k in range(2, 80)]}, "78 harmonics are too many: give the 64 largest"),
    ],
)
def test_bad_input(given: dict, message: str) -> None:
    with pytest.raises(rattle.ParameterError, match=message):
        rattle.Gear(0.6, 0.1, 0.6, **given)


def test_which_gear_it_is() -> None:
    elastic = rattle.Gear(0.6, 0.1, 0.6, restitution=1.0, load=0, harmonics=[])
    assert type(elastic) is rattle.Gear
    assert elastic == rattle.Gear(0.6, 0.1)
    for given in ({"restitution": 0.9}, {"load": 0.1}, {"harmonics": [(2, 0.1, 0.0)]}):
        assert isinstance(rattle.Gear(0.6, 0.1, **given), InelasticGear)
    gear = rattle.Gear(delta=0.6, epsilon=0.1, restitution=0.9, harmonics=[(7, 0.1, 1.25), (2, 0.1, 0.0)])
    assert gear.harmonics == ((2, 0.1, 0.0), (7, 0.1, 0.25))
    assert pickle.loads(pickle.dumps(gear)) == gear
    assert pickle.loads(pickle.dumps(elastic)) == elastic


def test_the_model() -> None:
    assert model_of(0.6, restitution=0.9) == Inelastic(0.6, 0.9)
    assert model_of(0.6, restitution=0.9, load=1.0) == Inelastic(0.6, 0.9, 1.0)
    assert model_of(0.6).name == "impacting"
    gear = Inelastic(0.5, 0.8, 0.2, ((3, 0.1, 0.0),)).gear(0.6, 0.1)
    assert gear == rattle.Gear(0.6, 0.1, 0.5, restitution=0.8, load=0.2, harmonics=[(3, 0.1, 0.0)])
    with pytest.raises(rattle.ParameterError, match="at most 1"):
        Inelastic(0.6, 1.5)
    with pytest.raises(rattle.RattleError, match="bifurcation diagrams are not computed for the inelastic gear"):
        Inelastic().diagram((0.6, 0.1), (0.6, 0.2))
