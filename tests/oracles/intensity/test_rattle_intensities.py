"""Intensities of tables of attractors: those of the single gear, exact balances, closed forms, honest errors."""

import math

import numpy as np
import pytest

import rattle
from rattle.attractors import SampleSpec
from rattle.attractors.samples import Outcome
from rattle.attractors.table import AttractorTable
from rattle.impacting.orbits.limits import flip_formula, sn1_formula
from rattle.intensity.table import Intensities
from rattle.models import Model, model_of

FIELDS = ("impacts_plus", "impacts_minus", "mean_speed", "largest_speed", "energy", "contact", "impulse")
DELTA = {"impacting": np.linspace(0.4, 1.0, 60), "stiff": np.array([0.4, 0.6, 0.8])}
EPSILON = {"impacting": np.tile([0.05, 0.1, 0.2], 20), "stiff": np.array([0.2, 0.1, 0.06])}


@pytest.fixture(scope="module", params=["impacting", "stiff"])
def found(request: pytest.FixtureRequest) -> tuple[Model, np.ndarray, np.ndarray, AttractorTable, Intensities]:
    delta, epsilon = DELTA[request.param], EPSILON[request.param]
    model = model_of(0.6, kappa=1e4 if request.param == "stiff" else None)
    table = model.attractors_of(delta, epsilon, SampleSpec(16))
    return model, delta, epsilon, table, model.intensities_of(delta, epsilon, table)


def test_periodic_and_quiet_ones_are_those_of_the_gear(found) -> None:
    model, delta, epsilon, table, rattles = found
    for name in ("quiet", "periodic"):
        rows = np.flatnonzero(table.kind == rattle.KINDS.index(name))
        assert rows.size > 1
        for row in rows:
            gear = model.gear(delta[table.cell[row]], epsilon[table.cell[row]])
            tau, v = table.tau[row], table.v[row]
            one = rattle.Attractor(
                name, table.m[row], table.n_plus[row], 0, 1.0, (0, 1), (math.nan, math.nan), 0.0, tau, v
            )
            single = gear.intensity(one)
            for field in FIELDS:
                assert getattr(rattles, field)[row] == pytest.approx(getattr(single, field), rel=1e-12)
    settled = (table.kind == Outcome.QUIET) | (table.kind == Outcome.PERIODIC)
    for error in rattles[7:]:
        assert not error[settled].any()


def test_impulses_balance(found) -> None:
    _model, delta, _epsilon, table, rattles = found
    drift = 2 * math.pi * delta[table.cell]
    settled = (table.kind == Outcome.QUIET) | (table.kind == Outcome.PERIODIC)
    np.testing.assert_allclose(rattles.impulse[settled], drift[settled], rtol=1e-10)
    chaos = table.kind == Outcome.CHAOTIC
    assert chaos.any()
    # over T periods what is left is a difference of two speeds over T
    off = np.abs(rattles.impulse - drift)[chaos]
    assert (off < 2 * rattles.largest_speed[chaos] / 512).all()
    assert np.isnan(rattles.energy[table.kind == Outcome.UNDECIDED]).all()


def test_a_stable_c_has_one_impact_of_speed_2_pi_delta() -> None:
    delta = np.array([2e-3, 0.1, 0.6, 0.75])
    for each in delta:
        model = model_of(5 * each)
        epsilon = 0.5 * float(sn1_formula(each) + flip_formula(each))
        table = model.attractors_of(each, epsilon, SampleSpec(64))
        rattles = model.intensities_of(each, epsilon, table)
        row = np.flatnonzero((table.m == 1) & (table.n_plus == 1) & (table.n_minus == 0))
        assert row.size == 1
        speed = 2 * math.pi * each
        assert (rattles.impacts_plus[row], rattles.impacts_minus[row]) == (1.0, 0.0)
        assert rattles.mean_speed[row] == pytest.approx(speed, rel=1e-10)
        assert rattles.largest_speed[row] == pytest.approx(speed, rel=1e-10)
        assert rattles.energy[row] == pytest.approx(speed**2 / 2, rel=1e-10)


def test_chaos_is_that_of_a_longer_watch_within_its_errors(found) -> None:
    model, delta, epsilon, table, rattles = found
    hits, rows = 0, np.flatnonzero(table.kind == Outcome.CHAOTIC)[:20]
    for row in rows:
        gear = model.gear(delta[table.cell[row]], epsilon[table.cell[row]])
        chaotic = rattle.Attractor("chaotic", 0, 0, 0, 1.0, (0, 1), (0, 0), 0.0, table.tau[row], table.v[row])
        longer = gear.intensity(chaotic, 8000.0 if model.name == "impacting" else 2000.0)
        for field in ("impacts_plus", "impacts_minus", "mean_speed", "energy"):
            error = getattr(rattles, f"{field}_error")[row]
            spread = math.hypot(error, getattr(longer.errors, field))
            assert abs(getattr(rattles, field)[row] - getattr(longer, field)) < 2.5 * spread
        assert 0.0 < rattles.energy_error[row] < 0.2 * rattles.energy[row]
        hits += abs(rattles.energy[row] - longer.energy) < math.hypot(rattles.energy_error[row], longer.errors.energy)
    assert hits >= 0.8 * rows.size


def test_a_cell_does_not_depend_on_the_others(found) -> None:
    model, delta, epsilon, table, rattles = found
    for cell in table.cell[np.flatnonzero(table.kind == Outcome.CHAOTIC)][:2]:
        alone = model.attractors_of(delta[cell], epsilon[cell], SampleSpec(16))
        again = model.intensities_of(delta[cell], epsilon[cell], alone)
        for one, all_ in zip(again, rattles, strict=True):
            np.testing.assert_array_equal(one, all_[table.cell == cell])


def test_chaos_that_comes_to_rest_is_not_known() -> None:
    model = model_of(0.6)
    table = model.attractors_of(0.6, 0.05, SampleSpec(8))
    assert list(table.kind) == [Outcome.QUIET]
    wrong = table.replace(kind=np.array([Outcome.CHAOTIC]), tau=np.array([0.3]), v=np.array([1.0]))
    assert all(np.isnan(values).all() for values in model.intensities_of(0.6, 0.05, wrong))
    wrong = table.replace(
        kind=np.array([Outcome.PERIODIC]), n_plus=np.array([1]), tau=np.array([0.3]), v=np.array([1.0])
    )
    assert np.isnan(model.intensities_of(0.6, 0.05, wrong).energy).all()
