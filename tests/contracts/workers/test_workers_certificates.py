"""Certificates of a survey: what they say, where they are, and that the survey stays as it was."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from depth import deep

from rattle.proof.check import check
from workers import SurveyRequest, create_store, examine, finish_store, open_survey, run_tiles_here, tiles_of
from workers import certificates as certified
from workers.certificates import CERTIFICATES, REFUSED, certify_survey
from workers.errors import SurveyError

BODY = {
    "delta": {"start": 0.55, "stop": 0.65, "num": 3},
    "epsilon": {"start": 0.06, "stop": 0.09, "num": 3},
    "initial_conditions": {"count": 16},
    "quantities": ["attractors"],
}


def computed(path: Path, **changes):
    request = SurveyRequest(**{**BODY, **changes})
    create_store(request, path)
    run_tiles_here(request, path, tiles_of(request), lambda _: None, lambda: False)
    finish_store(path)
    return path


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return computed(tmp_path_factory.mktemp("survey") / "survey.zarr")


@pytest.fixture(scope="module")
def whole(store):
    """Where the certificates of the survey are."""
    out = store.with_name("survey.certificates.zarr")
    with open_survey(store) as survey:
        certify_survey(survey, out)
    return out


def files(path):
    return {str(each): hashlib.sha256(each.read_bytes()).hexdigest() for each in path.rglob("*") if each.is_file()}


def lines(out):
    return (out / CERTIFICATES).read_text().splitlines()


def test_every_periodic_attractor_is_proved_and_checked(store, whole):
    survey, proved = xr.open_zarr(store, chunks=None), xr.open_zarr(whole, chunks=None)
    periodic = (survey.attractor_kind == 2).values
    assert periodic.sum() > 5
    assert (proved.attractor_certificate.values == periodic).all()
    assert proved.attractor_certificate.attrs["flag_meanings"] == "none orbit"
    radius = proved.attractor_certificate_radius.values
    assert (radius[periodic] == 1e-11).all()
    assert np.isnan(radius[~periodic]).all()
    for line in lines(whole):
        document = json.loads(line)
        check(line)
        slot, (i, j) = document["slot"], document["cell"]
        names = ("attractor_m", "attractor_n_plus", "attractor_n_minus")
        assert document["label"] == [int(survey[name].values[slot, i, j]) for name in names]
        assert float(document["parameters"]["delta"]) == survey.delta.values[j]
        assert float(document["parameters"]["epsilon"]) == survey.epsilon.values[i]
        assert document["verdict"] == "attracting"
    assert len(lines(whole)) == periodic.sum()
    assert (whole / REFUSED).read_text() == ""


def test_the_survey_is_left_as_it_is_and_opens_beside_them(store, tmp_path):
    before = files(store)
    with open_survey(store) as survey:
        certify_survey(survey, tmp_path / "certificates.zarr")
    assert files(store) == before
    assert examine(store).whole
    both = xr.merge([xr.open_zarr(store), xr.open_zarr(tmp_path / "certificates.zarr")], combine_attrs="drop_conflicts")
    assert int(both.attractor_certificate.where(both.attractor_kind != 2, 0).sum()) == 0


def test_a_run_that_was_stopped_or_killed_is_resumed(store, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(certified, "AT_ONCE", 2)
    out, seen = tmp_path / "certificates.zarr", []
    with open_survey(store) as survey:
        certify_survey(survey, out, on_done=seen.append, should_stop=lambda: True)
        assert len(lines(out)) == 2 == int(xr.open_zarr(out).attractor_certificate.sum())
        with (out / CERTIFICATES).open("a") as file:
            file.write('{"cell": [0, 0], "sl')  # where a killed run was
        certify_survey(survey, out, on_done=seen.append)
    assert seen[:3] == [0, 2, 2]
    assert lines(out) == lines(whole)
    xr.testing.assert_identical(xr.open_zarr(out).load(), xr.open_zarr(whole).load())


def test_what_is_not_proved_says_why_and_is_none(store, tmp_path):
    with open_survey(store) as opened:
        survey = opened.load()
    survey.attractor_n_minus[:, 0] += 1
    survey.attractor_velocity[:, 1] *= 0.1
    found = certify_survey(survey, tmp_path / "certificates.zarr")
    refused = [json.loads(line) for line in (tmp_path / "certificates.zarr" / REFUSED).read_text().splitlines()]
    assert {each["cell"][0] for each in refused} == {0, 1}
    assert all("not a P" in each["refused"] for each in refused if each["cell"][0] == 0)
    assert all(found.attractor_certificate.values[each["slot"], *each["cell"]] == 0 for each in refused)


def test_other_places_and_other_surveys_are_refused(store, whole, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "text").write_text("mine")
    with open_survey(store) as survey, pytest.raises(SurveyError, match="choose another path"):
        certify_survey(survey, tmp_path / "mine")
    assert files(tmp_path / "mine").keys() == {str(tmp_path / "mine" / "text")}
    other = computed(tmp_path / "other.zarr", seed=1)
    with open_survey(other) as survey, pytest.raises(SurveyError, match="choose another path"):
        certify_survey(survey, whole)
    plain = computed(tmp_path / "plain.zarr", quantities=["region"])
    with open_survey(plain) as survey, pytest.raises(SurveyError, match="no attractors"):
        certify_survey(survey, tmp_path / "plain")


def test_attractors_of_the_stiff_gear_are_proved_at_the_stiffness_of_the_request(tmp_path):
    body = {"model": "stiff", "kappa": 1e4, "delta": {"start": 0.6, "stop": 0.61, "num": 2}}
    store = computed(tmp_path / "stiff.zarr", **body, epsilon={"start": 0.0615, "stop": 0.062, "num": 2})
    with open_survey(store) as survey:
        found = certify_survey(survey, tmp_path / "certificates.zarr")
    assert int(found.attractor_certificate.sum()) >= 1
    assert json.loads(lines(tmp_path / "certificates.zarr")[0])["parameters"]["kappa"] == "10000"


@deep
def test_processes_give_the_same(store, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(certified, "AT_ONCE", 3)
    with open_survey(store) as survey:
        certify_survey(survey, tmp_path / "certificates.zarr", processes=2)
    assert lines(tmp_path / "certificates.zarr") == lines(whole)
