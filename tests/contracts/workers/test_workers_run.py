"""A survey from Python in one call: the numbers of `rattle run`, resumed and opened."""

from pathlib import Path
from typing import Any

import pytest
from service_processes import assert_bit_identical, serial_run

import gear_rattle
import gear_rattle.workers.run
from gear_rattle.workers import SurveyError, SurveyRequest, run_survey

pytestmark = pytest.mark.usefixtures("templates_once")

AXES: dict[str, Any] = {"delta": (0.45, 0.9, 4), "epsilon": (0.02, 0.25, 4)}
SMALL: dict[str, Any] = {"initial_conditions": {"count": 8}, "tile": {"delta": 2, "epsilon": 2}}
REQUEST = SurveyRequest(**AXES, **SMALL)


def test_one_call_computes_and_opens_a_survey(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    survey = run_survey(REQUEST, out=tmp_path / "s.zarr", progress=lambda *cells: seen.append(cells))
    assert seen == [(4, 16), (8, 16), (12, 16), (16, 16)]
    assert_bit_identical(survey, serial_run(REQUEST))
    again = run_survey(SMALL, **AXES, out=tmp_path / "s.zarr", progress=lambda *cells: seen.append(cells))
    assert len(seen) == 4  # nothing was computed again
    assert again.attrs["date_completed"] == survey.attrs["date_completed"]


def test_without_a_place_the_values_are_in_memory() -> None:
    survey = gear_rattle.run_survey(**AXES, quantities=("region",))
    assert not Path(survey.encoding["source"]).exists()
    assert survey.region.shape == (4, 4)


def test_what_was_interrupted_goes_on(tmp_path: Path) -> None:
    def stop(done: int, _: int) -> None:
        if done == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_survey(REQUEST, out=tmp_path / "s.zarr", progress=stop)
    seen: list[int] = []
    survey = run_survey(REQUEST, out=tmp_path / "s.zarr", progress=lambda done, _: seen.append(done))
    assert seen[-1] == 16
    assert len(seen) <= 2
    assert_bit_identical(survey, serial_run(REQUEST))


def test_fields_win_over_the_request() -> None:
    survey = run_survey(REQUEST, name="other", quantities=("region",))
    assert survey.attrs["title"] == "other"
    assert "quiet_fraction" not in survey


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"delta": (0.9, 0.45, 4)}, "delta: .*below stop"),
        ({"delta": (0.4, 0.9)}, "delta"),
        ({"beta": -1.0}, "beta: .*greater than 0"),
        ({"bets": 1.0}, r"bets: is not a known field: did you mean beta"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_a_sentence(fields: dict[str, Any], said: str) -> None:
    with pytest.raises(SurveyError, match=said):
        run_survey(REQUEST, **fields)


def test_a_long_survey_or_a_wish_takes_a_cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def client(cluster: Any) -> Any:
        asked.append(cluster)
        raise SurveyError("there is no cluster in this test")

    monkeypatch.setattr(gear_rattle.workers.run, "_open_client", client)
    for fields in ({"cluster": "tcp://scheduler:8786"}, {"initial_conditions": {"count": 65_536}}, {"cluster": 3}):
        with pytest.raises(SurveyError, match="no cluster"):
            run_survey(REQUEST, out=tmp_path / f"{len(asked)}.zarr", **fields)
    assert asked == ["tcp://scheduler:8786", None, 3]
