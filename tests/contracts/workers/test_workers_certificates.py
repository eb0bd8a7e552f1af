"""Certificates of a survey: what they say, where they are, and that the survey stays as it was."""

import hashlib
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import rattle
from gear_rattle.workers import (
    SurveyRequest,
    complete,
    create_store,
    examine,
    finish_store,
    is_incomplete,
    open_survey,
    run_survey,
    run_tiles_in_this_process,
    tiles_of,
)
from gear_rattle.workers import certificates as certified
from gear_rattle.workers.certificates import (
    CERTIFICATES,
    CHECKSUMS_FILE,
    REFUSED,
    certify_survey,
    examine_certificates,
    examine_certificates_beside_survey,
)
from gear_rattle.workers.errors import SurveyError
from rattle.proof.check import check

pytestmark = pytest.mark.usefixtures("templates_once")

BODY = {
    "delta": {"start": 0.55, "stop": 0.65, "num": 3},
    "epsilon": {"start": 0.06, "stop": 0.09, "num": 3},
    "initial_conditions": {"count": 16},
    "quantities": ["attractors"],
}


def computed(path: Path, **changes):
    request = SurveyRequest(**{**BODY, **changes})
    create_store(request, path)
    run_tiles_in_this_process(request, path, tiles_of(request), lambda _: None, lambda: False)
    finish_store(path)
    return path


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return computed(tmp_path_factory.mktemp("survey") / "survey.zarr")


@pytest.fixture(scope="module")
def whole(store):
    """Return the path of the survey's certificates."""
    out = store.with_name("survey.certificates.zarr")
    with open_survey(store) as survey:
        certify_survey(survey, out)
    return out


def files(path):
    return {
        each.relative_to(path).as_posix(): hashlib.sha256(each.read_bytes()).hexdigest()
        for each in path.rglob("*")
        if each.is_file()
    }


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
    assert examine(store).is_whole
    both = xr.merge([xr.open_zarr(store), xr.open_zarr(tmp_path / "certificates.zarr")], combine_attrs="drop_conflicts")
    assert int(both.attractor_certificate.where(both.attractor_kind != 2, 0).sum()) == 0


def test_a_run_that_was_stopped_or_killed_is_resumed(store, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(certified, "AT_ONCE", 2)
    out, seen = tmp_path / "certificates.zarr", []

    def told(*numbers):
        seen.append(numbers)

    with open_survey(store) as survey:
        certify_survey(survey, out, on_done=told, should_stop=lambda: True)
        assert len(lines(out)) == 2 == int(xr.open_zarr(out).attractor_certificate.sum())
        with (out / CERTIFICATES).open("a") as file:
            file.write('{"cell": [0, 0], "sl')  # where a killed run was
        certify_survey(survey, out, on_done=told)
    assert [done for done, _ in seen[:3]] == [0, 2, 2]
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
    assert files(tmp_path / "mine").keys() == {"text"}
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


def test_however_they_are_shared_out_the_files_are_the_same(store, whole, tmp_path, monkeypatch):
    monkeypatch.setattr(certified, "AT_ONCE", 3)
    given = []

    def prove(parts):
        given.append([len(part) for part in parts])
        return certified.prove_in_this_process(parts)

    with open_survey(store) as survey:
        certify_survey(survey, tmp_path / "certificates.zarr", prove, at_once=2)
    assert given[0] == [3, 3]
    assert files(tmp_path / "certificates.zarr") == files(whole)


@pytest.mark.parametrize("name", [CERTIFICATES, "zarr.json", "attractor_certificate/c/0/0/0"])
def test_what_is_damaged_at_the_end_is_proved_anew(store, whole, tmp_path, name):
    out = tmp_path / "certificates.zarr"
    shutil.copytree(whole, out)
    (tmp_path / "mine").mkdir()
    for path in (out / "mine", tmp_path / "mine" / "mine"):
        path.write_text("what is none of it stays")
    (out / name).write_bytes((out / name).read_bytes()[:-9] + b"damaged}\n")
    with open_survey(store) as survey:
        certify_survey(survey, out)
    assert files(out) == files(whole) | files(tmp_path / "mine")


def test_a_survey_that_asks_for_it_is_proved_after_its_tiles_beside_it(tmp_path, whole):
    request = SurveyRequest(**BODY, certify=True)
    out = tmp_path / "survey.zarr"
    run_survey(request, out=out).close()
    beside = tmp_path / "survey.certificates.zarr"
    assert lines(beside) == lines(whole)
    assert not is_incomplete(request, out)
    assert not is_incomplete(SurveyRequest(**BODY), out)
    (beside / REFUSED).write_text("?")
    assert is_incomplete(request, out)
    told = []
    complete(request, out, on_proved=lambda *numbers: told.append(numbers))
    assert told == [(0, len(lines(whole))), (len(lines(whole)),) * 2]
    assert not is_incomplete(request, out)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"quantities": ["region"]}, "certify needs attractors: add attractors to quantities"),
        ({"beta": {"start": 0.5, "stop": 0.6, "num": 2}}, "give one number for beta"),
        ({"certify": 1}, "certify"),
        ({}, "give `out`"),
    ],
)
def test_what_cannot_be_proved_is_said_before_anything_is_computed(changes, why):
    with pytest.raises(SurveyError, match=why):
        run_survey({**BODY, "certify": True, **changes})


def test_certificates_are_not_in_a_bucket():
    with pytest.raises(SurveyError, match="leave out certify"):
        run_survey({**BODY, "certify": True}, out="s3://bucket/survey.zarr")


def test_without_the_extra_nothing_is_computed_in_vain(tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.startswith("rattle.proof.balls")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "flint", None)
    with pytest.raises(rattle.MissingExtraError, match=r"gear-rattle\[proof\]"):
        run_survey({**BODY, "certify": True}, out=tmp_path / "survey.zarr")
    assert not (tmp_path / "survey.zarr").exists()


def beside(store, whole, where):
    """Copies of the survey and of its certificates, side by side."""
    return (
        shutil.copytree(store, where / "survey.zarr"),
        shutil.copytree(whole, where / "survey.certificates.zarr"),
    )


def test_certificates_beside_a_survey_are_examined_with_it(store, whole, tmp_path):
    survey, out = beside(store, whole, tmp_path)
    shutil.copytree(whole, tmp_path / "survey.slice2.certificates.zarr")
    shutil.copytree(whole, tmp_path / "surveyor.certificates.zarr")  # of another one
    found = examine_certificates_beside_survey(survey)
    assert [each.path.name for each in found] == ["survey.certificates.zarr", "survey.slice2.certificates.zarr"]
    assert all(each.complete and not each.damaged and each.files > 5 for each in found)
    (out / CERTIFICATES).write_text("\n".join(lines(out)[1:]))
    (out / "delta" / "c" / "0").unlink()
    first, _ = examine_certificates_beside_survey(survey)
    assert set(first.damaged) == {CERTIFICATES, "delta/c/0"}
    (out / CHECKSUMS_FILE).write_text("{")
    assert examine_certificates(out).damaged == (CHECKSUMS_FILE,)
    (out / CHECKSUMS_FILE).unlink()
    assert not examine_certificates(out).complete


def test_certificates_that_a_completed_survey_asked_for_are_lost_if_they_are_not_there(tmp_path):
    asked = SurveyRequest(**{**BODY, "certify": True})
    create_store(asked, tmp_path / "survey.zarr")
    assert examine_certificates_beside_survey(tmp_path / "survey.zarr") == []
    run_tiles_in_this_process(asked, tmp_path / "survey.zarr", tiles_of(asked), lambda _: None, lambda: False)
    complete(asked, tmp_path / "survey.zarr")
    finish_store(tmp_path / "survey.zarr")
    (whole,) = examine_certificates_beside_survey(tmp_path / "survey.zarr")
    assert whole.complete
    assert not whole.damaged
    shutil.rmtree(tmp_path / "survey.certificates.zarr")
    (lost,) = examine_certificates_beside_survey(tmp_path / "survey.zarr")
    assert lost.damaged == (CHECKSUMS_FILE,)
