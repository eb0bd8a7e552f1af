"""Requests for surveys: every sensible one is accepted, all others get a message that says what to do."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

import gear_rattle.workers.survey.request
from gear_rattle.workers import Axis, Group, InitialConditions, SurveyError, SurveyRequest, compute_tile, tiles_of
from gear_rattle.workers.survey.values.quantities import stored_variables

AXES = {"delta": {"start": 0.4, "stop": 1.0, "num": 61}, "epsilon": {"start": 0.005, "stop": 0.3, "num": 60}}


def survey(**fields: object) -> SurveyRequest:
    return SurveyRequest.model_validate(AXES | fields)


def test_defaults() -> None:
    request = survey()
    assert (request.beta, request.seed, request.name) == (0.6, 0, "")
    assert (request.initial_conditions.count, request.initial_conditions.v_max) == (64, None)
    assert (request.v_max, request.n_slots, request.initial_conditions.budget) == (7.0, 8, 1_000_000)
    assert request.quantities == ("region", "orbits", "attractors", "lyapunov", "grazing")  # what is cheap
    assert (request.n_cells, request.tile_shape, request.n_tiles) == (3660, (15, 15), 20)


SMALL = {"delta": {"start": 0.001, "stop": 0.01, "num": 20}, "epsilon": {"start": 0.0001, "stop": 0.003, "num": 20}}


@pytest.mark.parametrize(
    "outside",
    [
        {"beta": 0.1},
        {"beta": 1.3},
        {"delta": AXES["delta"] | {"start": 0.29}},
        {"epsilon": AXES["epsilon"] | {"stop": 0.6}},
    ],
)
def test_speeds_are_natural_by_default_outside_the_papers_plane(outside) -> None:
    assert survey(**outside).v_max == "natural"
    assert survey(**outside, initial_conditions={"v_max": 7.0}).v_max == 7.0
    assert survey(initial_conditions={"v_max": "natural"}).v_max == "natural"


def test_the_sample_is_of_a_box() -> None:
    box = {"count": 8, "tau_min": 0.77, "tau_max": 0.81, "v_min": 3.7, "v_max": 3.8}
    axes = {"delta": {"start": 0.6, "stop": 0.601, "num": 2}, "epsilon": {"start": 0.0615, "stop": 0.062, "num": 2}}
    request = SurveyRequest(**axes, quantities=("attractors",), initial_conditions=box)
    assert request.initial_conditions.tau_range == (0.77, 0.81)
    tile = tiles_of(request)[0]
    arrays, _record = compute_tile(request, tile)
    assert (arrays["quiet_fraction"] < 0.2).all()
    whole, _record = compute_tile(request.model_copy(update={"initial_conditions": InitialConditions(count=8)}), tile)
    assert (whole["quiet_fraction"] > 0.5).all()
    assert request.content_hash() != survey().content_hash()


@pytest.mark.parametrize(
    ("sample", "message"),
    [
        ({"tau_min": 0.5, "tau_max": 0.5}, "tau_min .0.5. must be less than tau_max"),
        ({"tau_max": 1.5}, "less than or equal to 1"),
        ({"v_min": 1.0}, "v_min above 0 needs a v_max that is a number"),
        ({"v_min": 7.0, "v_max": 7.0}, "v_min .7.0. must be less than v_max"),
    ],
)
def test_boxes_that_are_none_are_refused(sample: dict[str, float], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        survey(initial_conditions=sample)


def test_more_slots_by_default_where_there_are_more_attractors() -> None:
    assert survey(**SMALL, beta=0.002).n_slots == 24
    assert survey(**SMALL, beta=0.002, slots=3).n_slots == 3


def test_a_default_is_the_same_survey_as_its_value_written_out() -> None:
    assert survey().content_hash() == survey(slots=8, initial_conditions={"v_max": 7.0}).content_hash()
    assert survey().content_hash() != survey(slots=9).content_hash()
    assert survey().content_hash() != survey(initial_conditions={"budget": 999_999}).content_hash()
    assert survey().content_hash() != survey(initial_conditions={"v_max": "natural"}).content_hash()


def test_a_default_tile_is_smaller_where_samples_are_watched_for_longer() -> None:
    assert survey(**SMALL, beta=0.002).tile_shape == (4, 4)


def test_a_default_tile_shrinks_to_the_grid_and_a_given_one_does_not() -> None:
    small = {"start": 0.4, "stop": 1.0, "num": 5}
    assert survey(delta=small).tile_shape == (4, 4)
    assert survey(delta=small, tile={"delta": 5}).tile_shape == (4, 5)
    with pytest.raises(ValidationError, match=r"tile\.delta \(6\) exceeds the axis \(5 values\): use 5 or less"):
        survey(delta=small, tile={"delta": 6})


@pytest.mark.parametrize(("count", "side"), [(1, 100), (64, 100), (256, 64), (4096, 16), (65_536, 4)])
def test_a_default_tile_holds_fewer_cells_the_more_samples_each_has(count: int, side: int) -> None:
    large = {"delta": AXIS | {"num": 1000}, "epsilon": AXIS | {"num": 1000}}
    assert survey(**large, initial_conditions={"count": count}).tile_shape == (side, side)
    assert survey(**large, initial_conditions={"count": count}, quantities=["region"]).tile_shape == (100, 100)
    assert survey(**large, initial_conditions={"count": count}, quantities=["basins"]).tile_shape == (8, 8)


@pytest.mark.parametrize(("num", "side"), [(120, 30), (200, 32), (320, 32), (640, 64), (1000, 100), (4096, 128)])
def test_a_large_survey_has_a_hundred_tiles_until_they_take_too_long(num: int, side: int) -> None:
    large = {"delta": AXIS | {"num": num}, "epsilon": AXIS | {"num": num}}
    request = survey(**large)
    assert request.tile_shape == (side, side)
    variables = sum(quantity.is_per_cell for quantity in stored_variables(request.quantities, request.model)) + 1
    assert num > 1000 or request.n_tiles * variables < 5000  # files


def test_a_default_tile_of_cells_that_cost_little_is_no_larger_than_tiles_may_be() -> None:
    large = {"delta": AXIS | {"num": 16_384}, "epsilon": AXIS | {"num": 16_384}}
    assert survey(**large, quantities=["region"]).tile_shape == (256, 256)
    assert survey(**large, quantities=["region"], refine=True).tile_shape == (4096, 256)
    assert survey(**large, quantities=["region", "orbits"], refine=True).tile_shape == (256, 256)


AXIS = AXES["delta"]
BAD = [
    ({"delta": AXIS | {"start": math.nan}}, "finite"),
    ({"delta": AXIS | {"stop": math.inf}}, "finite"),
    ({"delta": AXIS | {"start": 10**400}}, "number"),
    ({"delta": AXIS | {"start": True}}, "number"),
    ({"delta": AXIS | {"start": "0.4"}}, "number"),
    ({"delta": AXIS | {"start": 1.0, "stop": 0.4}}, "below stop"),
    ({"delta": AXIS | {"start": 1.0}}, "below stop"),
    ({"delta": AXIS | {"num": 1}}, "greater than or equal to 2"),
    ({"delta": AXIS | {"num": 61.0}}, "integer"),
    ({"delta": AXIS | {"num": np.float64(61.0)}}, "integer"),
    ({"delta": (0.4, 1.0)}, "a triple in Python"),
    ({"delta": [0.4, 1.0, 61]}, "a triple in Python"),
    ({"delta": AXIS | {"num": 10**9}}, "less than or equal"),
    ({"delta": AXIS | {"start": 1.0, "stop": math.nextafter(1, 2)}}, "not distinct"),
    ({"delta": AXIS | {"start": -1.7e308, "stop": 1.7e308}}, "not distinct"),
    ({"delta": AXIS | {"start": 0.0}}, "positive"),
    ({"delta": AXIS | {"step": 0.1}}, "Extra inputs"),
    ({"epsilon": AXIS | {"start": -0.1}}, "not be negative"),
    ({"beta": 0.0}, "greater than 0"),
    ({"beta": math.nan}, "finite"),
    ({"quantities": []}, "at least one"),
    ({"quantities": ["region", "region"]}, "once"),
    ({"quantities": ["regions"]}, "region"),
    ({"initial_conditions": {"count": 0}}, "greater than or equal to 1"),
    ({"initial_conditions": {"count": 65_537}}, "less than or equal to 65536"),
    ({"initial_conditions": {"v_max": 0.0}}, "a speed above 0"),
    ({"tile": {"delta": 0}}, "greater than or equal to 1"),
    ({"tile": {"epsilon": 61}}, "exceeds the axis"),
    ({"tile": {"delta": 16.0}}, "integer"),
    ({"delta": AXIS | {"num": 300}, "epsilon": AXIS | {"num": 300}, "tile": {"delta": 300, "epsilon": 300}}, "smaller"),
    ({"delta": AXIS | {"num": 10**6}, "tile": {"delta": 1, "epsilon": 30}}, "larger tile"),
    (
        {
            "quantities": ["basins"],
            "delta": AXIS | {"num": 100},
            "epsilon": AXIS | {"num": 100},
            "tile": {"delta": 100, "epsilon": 100},
        },
        "initial conditions: use a smaller tile",
    ),
    ({"seed": -1}, "greater than or equal to 0"),
    ({"seed": 2**32}, "less than"),
    ({"name": "line\nbreak"}, "cannot be printed"),
    ({"name": "\ud800"}, "unicode"),
    ({"name": "n" * 201}, "at most 200"),
    ({"colour": "red"}, "Extra inputs"),
]


@pytest.mark.parametrize(("fields", "message"), BAD)
def test_refused_with_a_reason(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        survey(**fields)


def test_numbers_of_numpy_are_as_good_as_python_s() -> None:
    axis = (np.float32(0.5), np.float64(1.0), np.int64(3))
    found = survey(delta=axis, seed=np.uint8(7), initial_conditions={"count": np.int32(4)})
    plain = survey(delta=(0.5, 1.0, 3), seed=7, initial_conditions={"count": 4})
    assert found == plain
    assert found.model_dump_json() == plain.model_dump_json()


def test_frozen() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        survey().beta = 0.7


FLOATS = st.floats(min_value=0, max_value=1e300)


@given(start=FLOATS, width=FLOATS, num=st.integers(2, 500))
def test_an_accepted_axis_rises_from_start_to_stop(start: float, width: float, num: int) -> None:
    try:
        axis = Axis(start=start, stop=start + width, num=num)
    except ValidationError:
        return
    values = axis.values()
    assert values.shape == (num,)
    assert np.all(np.diff(values) > 0)
    assert (values[0], values[-1]) == (axis.start, axis.stop)


@given(start=st.floats(0.01, 1), width=st.floats(0.01, 10), num=st.integers(2, 10_000))
def test_axis_text_is_read_exactly(start: float, width: float, num: int) -> None:
    stop = start + width
    assert Axis.parse(f"{start!r}:{stop!r}:{num}") == Axis(start=start, stop=stop, num=num)


@pytest.mark.parametrize("text", ["", "0.4:1.0", "0.4:1.0:61:2", "a:b:c", "0.4:1.0:6.5", "1.0:0.4:61", "nan:1:3", "::"])
def test_bad_axis_text_says_how_to_write_it(text: str) -> None:
    with pytest.raises(SurveyError, match="START:STOP:NUM"):
        Axis.parse(text)


@given(st.text(max_size=30))
def test_any_axis_text_is_read_or_refused(text: str) -> None:
    try:
        axis = Axis.parse(text)
    except SurveyError:
        return
    assert text.count(":") == 2
    assert axis.num >= 2


def test_hash_is_of_the_content() -> None:
    request = survey()
    same = [
        survey(name="another name"),
        survey(quantities=list(reversed(request.quantities))),
        survey(tile={"delta": 15, "epsilon": 15}),
        SurveyRequest.model_validate_json(request.model_dump_json()),
    ]
    assert {other.content_hash() for other in same} == {request.content_hash()}


@pytest.mark.parametrize(
    "fields",
    [
        {"beta": 0.6000000000000001},
        {"seed": 1},
        {"delta": AXIS | {"num": 62}},
        {"quantities": ["region"]},
        {"quantities": list(Group)},
        {"tile": {"delta": 14}},
        {"initial_conditions": {"count": 65}},
        {"initial_conditions": {"v_max": 8.0}},
    ],
)
def test_hash_tells_surveys_apart(fields: dict[str, object]) -> None:
    assert survey(**fields).content_hash() != survey().content_hash()


def test_hash_tells_versions_of_the_code_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    before = survey().content_hash()
    monkeypatch.setattr(gear_rattle.workers.survey.request, "code_version", lambda: "another")
    assert survey().content_hash() != before
