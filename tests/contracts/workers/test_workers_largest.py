"""The families of a survey as maps: the largest one of each cell, the share of one, their names and colours."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from depth import deep

from gear_rattle.workers import (
    Axis,
    SurveyError,
    SurveyRequest,
    complete,
    create_store,
    open_family,
    open_survey,
    run_tiles_in_this_process,
)
from gear_rattle.workers.kinds import tiles_of
from gear_rattle.workers.pictures import largest
from gear_rattle.workers.pictures.largest import OTHERS, family_colours, family_names, open_survey_for_map
from gear_rattle.workers.pictures.look import LARGEST, SHARE, MapPictureOptions
from gear_rattle.workers.pictures.maps import render_map_picture
from rattle.plot.colours import KIND_COLOURS, colour

pytestmark = pytest.mark.usefixtures("templates_once")

REQUEST = SurveyRequest(
    delta=Axis(start=0.405, stop=0.5, num=12),
    epsilon=Axis(start=0.09, stop=0.14, num=10),
    quantities=("region", "attractors", "lyapunov", "families"),
    initial_conditions={"count": 8},
    tile={"delta": 5, "epsilon": 4},
)
THIRD = SurveyRequest.model_validate(
    REQUEST.model_dump()
    | {
        "beta": {"start": 0.55, "stop": 0.6, "num": 2},
        "delta": {"start": 0.41, "stop": 0.45, "num": 3},
        "tile": {"delta": 3, "epsilon": 4},
    }
)


CONTACT = SurveyRequest.model_validate(
    REQUEST.model_dump(exclude={"initial_conditions", "tile"})
    | {
        "model": "inelastic",
        "restitution": 0.9,
        "delta": {"start": 0.58, "stop": 0.62, "num": 3},
        "epsilon": {"start": 0.24, "stop": 0.26, "num": 3},
        "initial_conditions": {"count": 16},
    }
)


def tiles_only(request: SurveyRequest, path: Path) -> Path:
    create_store(request, path)
    run_tiles_in_this_process(request, path, tiles_of(request), lambda _: None, lambda: False)
    return path


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tiles_only(REQUEST, tmp_path_factory.mktemp("largest") / "survey.zarr")
    with pytest.raises(SurveyError, match="not joined yet"):
        open_survey_for_map(partial(open_survey, path), LARGEST)
    complete(REQUEST, path)
    return path


def test_each_cell_has_the_family_with_the_largest_share(stored: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    survey = open_survey_for_map(partial(open_survey, stored), LARGEST)
    assert survey[LARGEST].attrs["flag_values"][-1] == OTHERS  # there are more families than codes
    family, share = survey.attractor_family.values, survey.attractor_fraction.values
    expected = np.zeros((2, *REQUEST.shape), np.int8)
    for first, i, j in np.ndindex(expected.shape):
        shares: dict[int, float] = {}
        for number, part in zip(family[:, i, j].tolist(), share[:, i, j].tolist(), strict=True):
            if number >= first and part > 0:  # of what is known without a sample there is no share
                shares[number] = shares.get(number, 0.0) + part
        if shares:
            most = max(shares.values())
            number = min(each for each, part in shares.items() if part == most)
            expected[first, i, j] = min(number + 1, OTHERS)
    assert (expected == OTHERS).any()
    assert (expected[0] != expected[1]).any()
    np.testing.assert_array_equal(survey[LARGEST], expected)
    monkeypatch.setattr(largest, "BAND", 200)  # two rows at a time
    np.testing.assert_array_equal(survey[LARGEST][1, 1:8], expected[1, 1:8])
    np.testing.assert_array_equal(
        survey[LARGEST].isel(epsilon=[7, 2], delta=slice(None, None, -3)), expected[:, [7, 2], ::-3]
    )
    assert survey[LARGEST][0, 3, 4].item() == expected[0, 3, 4]


def test_the_share_of_one_is_that_of_its_map(stored: Path) -> None:
    survey = open_survey_for_map(partial(open_survey, stored), SHARE)
    for number in (0, 1, 4):
        one = open_family(stored, number)
        np.testing.assert_allclose(survey[SHARE][number], one.fraction.fillna(0.0), atol=1e-7)


def test_slots_of_one_family_are_added_and_of_equal_shares_the_lower_number_wins() -> None:
    family = np.array([[0, 3, 5, -1, 0], [2, 2, 4, -1, -1], [2, 3, -1, -1, -1]])[:, None]
    share = np.array([[0.4, 0.3, 0.5, np.nan, 1.0], [0.3, 0.4, 0.5, np.nan, np.nan], [0.3, 0.3, 0, np.nan, np.nan]])
    assert largest.dominant_families(family, share[:, None])[0].tolist() == [2, 3, 4, -1, 0]
    assert largest.dominant_families(family, share[:, None], first=1)[0].tolist() == [2, 3, 4, -1, -1]


def test_families_have_the_names_and_colours_of_their_motions(stored: Path) -> None:
    survey, table = (open_survey(stored, group) for group in (None, "families"))
    names, colours = family_names(survey, table), family_colours(table)
    of = {name: table[name].values for name in ("kind", "m", "n_plus", "n_minus")}
    assert names[0] == "quiet"
    assert colours[0] == KIND_COLOURS["quiet"]
    label = [tuple(int(of[name][i]) for name in ("m", "n_plus", "n_minus")) for i in range(len(colours))]
    c = label.index((1, 1, 0))
    assert names[c] == f"{c}: P(1,1,0) = C"
    assert colours[c] == colour((1, 1, 0))
    assert len(set(colours)) == len(colours)
    chaos = names.index(next(name for name in names if name.endswith(": chaos")))
    assert colours[chaos] == colour("chaotic")


@deep
def test_slices_have_families_of_their_own(tmp_path: Path) -> None:
    path = tiles_only(THIRD, tmp_path / "survey.zarr")
    complete(THIRD, path)
    for number in (0, 1):
        survey = open_survey_for_map(partial(open_survey, path), LARGEST, number)
        names = survey[LARGEST].attrs["flag_meanings"].split()[1:-1]
        table = open_survey(path, f"slices/{number}/families")
        assert [each.replace("_", " ") for each in names] == family_names(survey, table, len(names))
        expected = largest.dominant_families(survey.attractor_family.values, survey.attractor_fraction.values)
        np.testing.assert_array_equal(survey[LARGEST][0], np.minimum(expected + 1, OTHERS))


def test_what_cannot_be_drawn_says_why(stored: Path, tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="120 cells, and families can be drawn for at most 100: compute a"):
        open_survey_for_map(partial(open_survey, stored), LARGEST, limit=100)
    without = SurveyRequest.model_validate(REQUEST.model_dump() | {"quantities": ["region", "attractors"]})
    path = tiles_only(without, tmp_path / "survey.zarr")
    with pytest.raises(SurveyError, match="no families: compute a survey with --quantity families"):
        open_survey_for_map(partial(open_survey, path), LARGEST)
    assert LARGEST not in open_survey_for_map(partial(open_survey, path), "region")


def test_a_picture_has_the_map(stored: Path) -> None:
    survey = open_survey_for_map(partial(open_survey, stored), LARGEST)
    whole, window = (
        render_map_picture(survey, LARGEST, 1, look=look, form="svg")
        for look in (MapPictureOptions(), MapPictureOptions(delta=(0.42, 0.45)))
    )
    assert b"rattling" in whole
    assert whole != window


def test_families_with_contact_phases_are_named_as_their_attractors_are(tmp_path: Path) -> None:
    path = tiles_only(CONTACT, tmp_path / "contact.zarr")
    complete(CONTACT, path)
    with open_survey(path) as survey, open_survey(path, "families") as table:
        names = [each.rpartition(": ")[2] for each in family_names(survey, table)]
        for number, name in enumerate(names):
            of = (survey.attractor_family == number).values
            contacts = np.unique(survey.attractor_contacts.values[of])
            if table.kind[number] == 2:
                label = ",".join(str(int(table[each][number])) for each in ("m", "n_plus", "n_minus"))
                assert name in {f"P({label}{f';{each}' if each else ''})" for each in contacts}
        assert any(";" in name for name in names)
