"""Sounds against the sum that they are."""

import numpy as np
import pytest

import rattle


def test_every_impact_rings() -> None:
    gear = rattle.Gear(0.6, 0.089)
    attractor = next(each for each in gear.attractors(16) if each.kind == "periodic")
    rpm, seconds, rate, ring, decay = 1234.5, 0.4, 8000, 700.0, 0.004
    heard = gear.sound(attractor, rpm, seconds, rate, ring, decay)
    impacts = gear.impacts(attractor, seconds * rpm / 60)
    struck = (impacts.time - attractor.tau) * 60 / rpm
    since = np.arange(seconds * rate) / rate - struck[:, None]
    rings = np.exp(-since / decay, where=since >= 0, out=np.zeros_like(since)) * np.sin(2 * np.pi * ring * since)
    np.testing.assert_allclose(heard, impacts.impulse @ rings, atol=1e-10)


def test_quiet_is_silence() -> None:
    gear = rattle.Gear(0.6, 0.05)
    heard = gear.sound(gear.attractors(8)[0], 3000.0, 0.1)
    assert heard.shape == (4410,)
    assert not heard.any()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"rpm": 0.0}, "rpm"),
        ({"seconds": -1.0}, "seconds"),
        ({"ring": 30_000.0}, "choose a higher rate"),
        ({"seconds": 1e7}, "fewer seconds"),
        ({"decay": 0.0}, "decay"),
        ({"rate": 0}, "rate"),
    ],
)
def test_what_cannot_be_heard_is_refused(options: dict[str, float], said: str) -> None:
    gear = rattle.Gear(0.6, 0.1)
    with pytest.raises(rattle.ParameterError, match=said):
        gear.sound(gear.orbits()[0], **({"rpm": 3000.0} | options))
