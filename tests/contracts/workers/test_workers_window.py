"""Windows of the plane without a cluster: their grid, their levels, their parts."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from depth import deep

import gear_rattle.workers.cluster.window
from gear_rattle.workers import (
    SurveyError,
    SurveyRequest,
    Window,
    compute_tile,
    compute_window_part,
    quantity_of_map,
    request_for_window,
    tiles_of,
)
from gear_rattle.workers.cluster.window import WindowFrame, WindowGrid, WindowPartValues
from rattle import RattleError

REQUEST = SurveyRequest(
    delta={"start": 0.4, "stop": 1.0, "num": 7},
    epsilon={"start": 0.01, "stop": 0.3, "num": 5},
    quantities=["region", "orbits", "attractors", "lyapunov", "basins"],
    initial_conditions={"count": 8, "v_max": 6.0},
    seed=5,
    tile={"delta": 7, "epsilon": 5},
)
WINDOW = Window((0.55, 0.65), (0.08, 0.12))


def test_a_window_is_a_survey() -> None:
    survey = request_for_window(REQUEST, WINDOW, (70, 40))
    assert survey.shape == (33, 65)
    assert (survey.delta.start, survey.delta.stop) == WINDOW.delta
    assert (survey.epsilon.start, survey.epsilon.stop) == WINDOW.epsilon
    kept = {"beta", "quantities", "initial_conditions", "seed"}
    assert survey.model_dump(include=kept) == REQUEST.model_dump(include=kept)


@pytest.mark.parametrize(
    ("pixels", "cells"), [(2, 2), (3, 3), (4, 3), (9, 9), (20, 17), (33, 33), (64, 33), (800, 769)]
)
def test_an_axis_is_on_every_level(pixels: int, cells: int) -> None:
    assert request_for_window(REQUEST, WINDOW, (pixels, 2)).delta.num == cells


def test_what_is_beyond_the_plane_is_cut_off() -> None:
    survey = request_for_window(REQUEST, Window((-0.5, 0.5), (-0.1, 0.1)), (100, 100))
    assert survey.epsilon.start == 0
    assert 0 < survey.delta.start <= 0.01
    assert (survey.delta.stop, survey.epsilon.stop) == (0.5, 0.1)


def test_an_axis_is_no_finer_than_double_precision() -> None:
    survey = request_for_window(REQUEST, Window((0.6, 0.6 + 1e-14), (0.1, 0.2)), (800, 800))
    assert 2 <= survey.delta.num < 45
    assert survey.epsilon.num == 769


@pytest.mark.parametrize(
    ("window", "pixels", "words"),
    [
        (Window((0.6, 0.5), (0.1, 0.2)), (9, 9), "no width along delta"),
        (Window((0.5, 0.6), (0.1, 0.1)), (9, 9), "no width along epsilon"),
        (Window((-0.6, -0.5), (0.1, 0.2)), (9, 9), "outside the plane"),
        (Window((0.5, 0.6), (-0.2, 0.0)), (9, 9), "no width along epsilon|outside"),
        (Window((0.6, 0.6 + 3e-16), (0.1, 0.2)), (9, 9), "zoom out"),
        (Window((0.5, float("inf")), (0.1, 0.2)), (9, 9), "pair of numbers"),
        (Window((0.5, float("nan")), (0.1, 0.2)), (9, 9), "pair of numbers"),
        (Window(("a", "b"), (0.1, 0.2)), (9, 9), "delta"),
        (Window((0.5, 0.6), (0.1, 0.2)), (1, 9), "pixels"),
        (Window((0.5, 0.6), (0.1, 0.2)), (9, 10**6), "pixels"),
    ],
)
def test_windows_that_cannot_be(window: Any, pixels: tuple[int, int], words: str) -> None:
    with pytest.raises(RattleError, match=words):
        request_for_window(REQUEST, window, pixels)


@pytest.mark.parametrize(
    ("variable", "index"), [("weather", 0), ("grazing_epsilon", 0), ("orbit_phase", 4), ("region", 1)]
)
def test_maps_that_are_none(variable: str, index: int) -> None:
    with pytest.raises(SurveyError, match="map"):
        quantity_of_map(variable, index, REQUEST)


def filled(grid: WindowGrid, cells: int) -> list[tuple[int, WindowFrame]]:
    """Every level, each cell once, values that tell the cell."""
    number = np.arange(grid.values.size).reshape(grid.values.shape)
    frames = []
    for level in grid.levels:
        for block in grid.parts_of_level(level):
            for part in grid.divide_into_parts(block, cells):
                assert not grid.known[part].any()
                assert 0 < number[part].size <= cells
                grid.store_part(part, WindowPartValues(number[part], 0, 0.0))
        frames.append((level, grid.frame_at_level(level)))
    return frames


@pytest.mark.parametrize("pixels", [(2, 2), (33, 33), (65, 33), (97, 129), (17, 65)])
@pytest.mark.parametrize("cells", [1, 10, 100, 10**6])
def test_levels_cover_the_grid_and_each_cell_once(pixels: tuple[int, int], cells: int) -> None:
    survey = request_for_window(REQUEST, WINDOW, pixels)
    grid = WindowGrid(survey, quantity_of_map("lyapunov_max", 0, REQUEST))
    number = np.arange(grid.values.size).reshape(grid.values.shape)
    for level, frame in filled(grid, cells):
        step = 2**level
        np.testing.assert_array_equal(frame.values, number[::step, ::step])
        np.testing.assert_array_equal(frame.delta, survey.delta.values()[::step])
        np.testing.assert_array_equal(frame.epsilon, survey.epsilon.values()[::step])
        assert (frame.delta[-1], frame.epsilon[-1]) == (survey.delta.stop, survey.epsilon.stop)
        assert (frame.done == 1) == (level == 0)
    assert grid.known.all()


def test_meanwhile_a_cell_shows_its_neighbour_of_the_level_before() -> None:
    grid = WindowGrid(request_for_window(REQUEST, WINDOW, (33, 33)), quantity_of_map("quiet_fraction", 0, REQUEST))
    for part in grid.divide_into_parts(*grid.parts_of_level(grid.levels[0]), 10**6):
        grid.store_part(part, WindowPartValues(np.array([[0.0, 0.2], [0.4, 0.6]]), 0, 0.0))
    frame = grid.frame_at_level(grid.levels[1])
    np.testing.assert_allclose(frame.values, [[0, 0, 0.2], [0, 0, 0.2], [0.4, 0.4, 0.6]], rtol=1e-6)
    assert frame.done == 4 / 33**2
    assert grid.levels == (5, 4, 3, 2, 1, 0)
    assert WindowGrid(request_for_window(REQUEST, WINDOW, (33, 33)), quantity_of_map("region", 0, REQUEST)).levels == (
        0,
    )


@pytest.mark.parametrize(
    ("variable", "index"),
    [
        ("region", 0), ("quiet_fraction", 0), ("attractor_lyapunov", 1), ("crisis_side", 0),
        *(
            pytest.param(*each, marks=deep)
            for each in (("orbit_stable", 2), ("orbit_multiplier", 1), ("fraction_error", 0), ("sum_rule_error", 0),
                         ("status", 0), ("orbit_velocity", 3), ("attractor_m", 1))
        ),
    ],
)  # fmt: skip
def test_the_values_of_its_survey(variable: str, index: int) -> None:
    """In parts of any size, a survey with more quantities and other tiles: to the bit."""
    request = (
        REQUEST if variable == "crisis_side" else REQUEST.model_copy(update={"quantities": REQUEST.quantities[:-1]})
    )
    survey = request_for_window(request, WINDOW, (6, 4))
    (tile,) = tiles_of(survey.model_copy(update={"tile": REQUEST.tile.model_copy(update={"delta": 5, "epsilon": 3})}))
    values = compute_tile(survey, tile)[0]
    stored = values[variable] if variable in values else values[f"{variable}_real"] + 1j * values[f"{variable}_imag"]
    plane = stored if stored.ndim == 2 else stored[(index, *(0,) * (stored.ndim - 3))]
    grid = WindowGrid(survey, quantity_of_map(variable, index, REQUEST))
    for level in grid.levels:
        for block in grid.parts_of_level(level):
            for part in grid.divide_into_parts(block, 4):
                delta, epsilon = grid.delta[part.delta], grid.epsilon[part.epsilon]
                grid.store_part(part, compute_window_part(survey, variable, index, delta, epsilon))
    assert grid.values.dtype == plane.dtype
    np.testing.assert_array_equal(grid.values, plane)
    assert grid.failed == 0


@pytest.mark.parametrize(("variable", "lost"), [("lyapunov_max", np.nan), ("status", 3)])
def test_a_cell_that_fails_is_the_only_one_lost(monkeypatch: pytest.MonkeyPatch, variable: str, lost: float) -> None:
    request = REQUEST.model_copy(update={"quantities": REQUEST.quantities[:-1]})
    delta, epsilon = np.array([0.6, 0.7, 0.8]), np.array([0.09, 0.1])
    whole = compute_window_part(REQUEST, "lyapunov_max", 0, delta, epsilon).values

    def failing(cells: Any) -> np.ndarray:
        if 0.7 in cells.delta and 0.1 in cells.epsilon:
            raise ArithmeticError("a cell of this test")
        return healthy.evaluate(cells)

    healthy = quantity_of_map("lyapunov_max", 0, REQUEST)
    quantities = [
        replace(each, evaluate=failing) if each is healthy else each
        for each in gear_rattle.workers.cluster.window.QUANTITIES
    ]
    monkeypatch.setattr(gear_rattle.workers.cluster.window, "QUANTITIES", quantities)
    fails = quantity_of_map("lyapunov_max", 0, REQUEST)
    monkeypatch.setattr(
        gear_rattle.workers.cluster.window, "stored_variables", lambda *_: (quantities[-1], fails, quantities[-1])
    )
    values, failed, _ = compute_window_part(request, variable, 0, delta, epsilon)
    assert failed == 1
    np.testing.assert_equal(values[1, 1], lost)
    if variable == "lyapunov_max":
        whole[1, 1] = np.nan
        np.testing.assert_array_equal(values, whole)
    else:
        assert (np.delete(values.ravel(), 4) != 3).all()
