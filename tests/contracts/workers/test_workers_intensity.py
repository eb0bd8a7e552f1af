"""The group `intensity`: each cell holds what the library says of its attractors, weighted by their basins."""

import math

import numpy as np
import pytest

from gear_rattle.workers import Axis, SurveyRequest, TileShape, tiles_of
from gear_rattle.workers.survey.tiles import cells_of_tile, compute_tile
from gear_rattle.workers.survey.values.evaluate import FAILED, KINDS
from gear_rattle.workers.survey.values.quantities import stored_variables

FIELDS = {
    "delta": Axis(start=0.5, stop=0.9, num=5),
    "epsilon": Axis(start=0.05, stop=0.2, num=4),
    "quantities": ("attractors", "intensity"),
    "initial_conditions": {"count": 32},
}
STIFF = {
    "model": "stiff",
    "kappa": 1e4,
    "delta": Axis(start=0.55, stop=0.65, num=2),
    "initial_conditions": {"count": 8},
}
PER_SLOT = ("impacts_plus", "impacts_minus", "mean_speed", "largest_speed", "energy", "contact")

Arrays = dict[str, np.ndarray]


def computed(**fields: object) -> tuple[SurveyRequest, Arrays]:
    request = SurveyRequest.model_validate(FIELDS | {"tile": {"delta": 2}} | fields)
    whole = TileShape(delta=request.delta.num, epsilon=request.epsilon.num)
    (tile,) = tiles_of(request.model_copy(update={"tile": whole}))
    return request, compute_tile(request, tile)[0]


@pytest.fixture(scope="module", params=[{}, STIFF], ids=["impacting", "stiff"])
def survey(request: pytest.FixtureRequest) -> tuple[SurveyRequest, Arrays]:
    return computed(**request.param)


def test_slots_are_the_attractors_of_the_gear(survey: tuple[SurveyRequest, Arrays]) -> None:
    request, values = survey
    cells, kinds = cells_of_tile(request), set()
    for i, j in np.ndindex(values["status"].shape):
        gear = request.gear_model.gear(float(cells.delta[j]), float(cells.epsilon[i]))
        for slot, each in enumerate(gear.attractors(request.initial_conditions.count, request.v_max)):
            kinds.add(each.kind)
            at = {name: float(values[f"attractor_{name}"][slot, i, j]) for name in (*PER_SLOT, "level")}
            error = float(values["attractor_energy_error"][slot, i, j])
            if each.kind in ("quiet", "periodic"):
                known = gear.intensity(each)
                for name in PER_SLOT:
                    assert at[name] == pytest.approx(getattr(known, name), rel=1e-12)
                assert error == 0.0
                level = known.level(2 * math.pi**2 * gear.delta**2)
                assert at["level"] == (level if each.kind == "quiet" else pytest.approx(level, abs=1e-9))
            elif each.kind == "chaotic":
                known = gear.intensity(each, 1500.0)
                assert abs(at["energy"] - known.energy) < 3 * math.hypot(error, known.errors.energy)
                assert error > 0.0
    assert {"quiet", "periodic", "chaotic"} <= kinds


def test_cells_are_means_over_the_sample_and_the_worst(survey: tuple[SurveyRequest, Arrays]) -> None:
    request, values = survey
    for i, j in np.ndindex(values["status"].shape):
        one = {name: value[..., i, j] for name, value in values.items()}
        n, share = int(one["n_attractors"]), one["attractor_fraction"].astype(float)
        slots = {name: one[f"attractor_{name}"][:n] for name in (*PER_SLOT, "level", "energy_error")}
        share = share[:n]
        for name in ("impacts_plus", "impacts_minus", "energy", "contact"):
            assert float(one[f"sample_{name}"]) == pytest.approx(float(share @ slots[name]), rel=1e-6)
        rate = slots["impacts_plus"] + slots["impacts_minus"]
        if share @ rate:
            mean = float(share @ (rate * slots["mean_speed"]) / (share @ rate))
            assert float(one["sample_mean_speed"]) == pytest.approx(mean, rel=1e-6)
        assert float(one["sample_largest_speed"]) == slots["largest_speed"][share > 0].max()
        assert float(one["sample_energy_error"]) == pytest.approx(
            math.hypot(*(share * slots["energy_error"])), rel=1e-6
        )
        delta = float(cells_of_tile(request).delta[j])
        energy = float(one["sample_energy"])
        level = 10 * math.log10(energy / (2 * math.pi**2 * delta**2)) if energy else -math.inf
        assert float(one["sample_level"]) == pytest.approx(level, abs=1e-9)
        worst = int(np.argmax(slots["energy"]))
        for name in (*PER_SLOT, "level", "energy_error"):
            assert float(one[f"worst_{name}"]) == slots[name][worst]


def test_what_is_undecided_is_not_known() -> None:
    few = {"initial_conditions": {"count": 2, "budget": 16}, "epsilon": Axis(start=0.01, stop=0.1, num=2)}
    request = SurveyRequest.model_validate(FIELDS | few)
    values, _record = compute_tile(request, tiles_of(request)[0])
    assert (values["status"] < FAILED).all()
    undecided = values["undecided_fraction"] > 0
    assert undecided.any()
    assert not undecided.all()
    for name in ("sample_energy", "sample_mean_speed", "sample_largest_speed", "worst_energy", "worst_level"):
        np.testing.assert_array_equal(np.isnan(values[name]), undecided)
    slot = values["attractor_kind"] == KINDS.index("undecided")
    assert np.isnan(values["attractor_energy"][slot]).all()


def test_the_group_changes_no_other_variable() -> None:
    request, values = computed()
    _, without = computed(quantities=("attractors",))
    for name, value in without.items():
        assert value.tobytes() == values[name].tobytes(), name
    assert {each.name for each in stored_variables(request.quantities, request.model)} > set(without)


def test_tiles_do_not_show() -> None:
    request, values = computed()
    tile = tiles_of(request)[1]
    part, _record = compute_tile(request, tile)
    for name, value in part.items():
        assert value.tobytes() == np.ascontiguousarray(values[name][..., tile.epsilon, tile.delta]).tobytes(), name
