"""Figure 4 of the paper: basin fractions at δ = 0.6, against model values and against brute force."""

from collections import Counter

import numpy as np
import pytest
from depth import deep
from figure4 import KNOWN, label

import rattle

COUNT = 1024


def fractions(epsilon, seed=0):
    return {label(a): a.fraction for a in rattle.Gear(0.6, epsilon).attractors(count=COUNT, seed=seed)}


def tolerance(p, extra=0.0):
    """Four standard errors of a random sample (ours is better than random), and the reference's own error."""
    return 4 * np.sqrt(p * (1 - p) / COUNT) + extra


@pytest.mark.parametrize("epsilon", KNOWN)
def test_model_values(epsilon):
    found, known = fractions(epsilon), KNOWN[epsilon]
    assert {k for k, p in found.items() if p > 0.004} <= set(known)
    for name, p in known.items():
        assert found.get(name, 0.0) == pytest.approx(p, abs=tolerance(p, 0.01))
        assert name in found or p < 0.01


def brute_force(epsilon, side=40, settle=20_000):
    """Cell centres and long iteration only: quiet if slow at the end, else the orbit counted between exact returns."""
    gear = rattle.Gear(0.6, epsilon)
    centres = (np.arange(side) + 0.5) / side
    tau, v = (x.ravel() for x in np.meshgrid(centres, 7 * centres))
    tau, v, _, _ = gear.iterate(tau, v, settle)
    labels = []
    for t, speed in zip(tau, v, strict=True):
        if speed < 0.05:
            labels.append("quiet")
            continue
        t1, v1, periods, below = t, speed, 0.0, 0
        for n in range(1, 65):
            step = gear.impact(t1, v1)
            t1, v1, periods, below = step.tau, step.v, periods + step.time, below + step.n_minus
            if abs((t1 - t + 0.5) % 1 - 0.5) < 1e-7 and abs(v1 - speed) < 1e-7:
                labels.append((round(periods), n, below))
                break
        else:
            labels.append("chaotic")
    return {k: n / side**2 for k, n in Counter(labels).items()}


@pytest.mark.parametrize(
    "epsilon", [0.067, *(pytest.param(epsilon, marks=deep) for epsilon in (0.0725, 0.0835, 0.0945))]
)
def test_the_papers_other_four_by_brute_force(epsilon):
    found, reference = fractions(epsilon), brute_force(epsilon)
    for name in set(found) | set(reference):
        p = max(found.get(name, 0.0), reference.get(name, 0.0))
        assert found.get(name, 0.0) == pytest.approx(reference.get(name, 0.0), abs=tolerance(p, 0.005)), name
    assert {k for k, p in found.items() if p > 0.02} <= set(reference)
    assert {k for k, p in reference.items() if p > 0.02} <= set(found)


def test_the_label_of_d_is_period_one_between_sn2_and_pd1():
    """Figure 4(d): "a very small basin corresponding to D emerges"."""
    found = {
        a.n_minus: a for a in rattle.Gear(0.6, 0.0725).attractors(count=COUNT) if a.m == 1 and a.kind == "periodic"
    }
    orbit = {o.name: o for o in rattle.Gear(0.6, 0.0725).orbits()}["D"]
    assert found[1].tau == pytest.approx(orbit.tau, abs=1e-10)
    assert found[1].lyapunov[0] == pytest.approx(np.log(max(abs(x) for x in orbit.multipliers)), abs=1e-9)
    assert 0 < found[1].fraction < 0.03
