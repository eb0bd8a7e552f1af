"""A survey over speed and eccentricity: the plane of the machine, which plain xarray reads back in SI units."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from pydantic import ValidationError
from written import compute_and_write_tile

import rattle
from gear_rattle.workers import Axis, SurveyRequest, Window, create_store, finish_store, request_for_window, tiles_of
from gear_rattle.workers.pictures.figure import survey_figure
from gear_rattle.workers.pictures.look import MapPictureOptions
from gear_rattle.workers.pictures.machine_axes import tick_values
from gear_rattle.workers.pictures.maps import draw_map_figure, render_map_picture
from gear_rattle.workers.storage.export import csv_lines, write_netcdf

pytestmark = pytest.mark.usefixtures("templates_once")

GEARS = {"inertia": 0.003, "drag": 0.05, "backlash": 100e-6, "radius": 0.05}
SPANS = {
    "rpm": {"start": 1500.0, "stop": 6000.0, "num": 3},
    "eccentricity": {"start": 2e-6, "stop": 60e-6, "num": 4},
}
FIELDS = {"quantities": ("region", "attractors"), "initial_conditions": {"count": 8}}


def request_of(**changed: object) -> SurveyRequest:
    return SurveyRequest.model_validate(FIELDS | {"machine": GEARS | SPANS} | changed)


@pytest.fixture(scope="module", params=["torque", "speed"])
def stored(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[SurveyRequest, Path]:
    wanted = request_of(machine=GEARS | SPANS | {"drive": request.param})
    path = tmp_path_factory.mktemp("machine") / "survey.zarr"
    create_store(wanted, path)
    for tile in tiles_of(wanted):
        assert not compute_and_write_tile(wanted, str(path), tile).failed_cells
    finish_store(path)
    return wanted, path


def test_the_ends_of_the_axes_are_the_machines(stored: tuple[SurveyRequest, Path]) -> None:
    request, _path = stored
    drive = request.machine.drive
    slow, fast = (rattle.Machine(**GEARS, eccentricity=2e-6, rpm=rpm, drive=drive) for rpm in (1500.0, 6000.0))
    wide = rattle.Machine(**GEARS, eccentricity=60e-6, rpm=3000.0, drive=drive)
    assert (request.delta.start, request.delta.stop) == (fast.delta, slow.delta)
    assert (request.epsilon.start, request.epsilon.stop) == (slow.epsilon, wide.epsilon)
    assert request.beta == slow.beta == fast.beta
    assert request.shape == (4, 3)


def test_xarray_alone_reads_speeds_and_eccentricities(stored: tuple[SurveyRequest, Path]) -> None:
    request, path = stored
    survey = xr.open_zarr(path, chunks=None)
    assert {"rpm", "eccentricity"} <= set(survey.coords)
    assert (survey.rpm.dims, survey.eccentricity.dims) == (("delta",), ("epsilon",))
    assert (survey.rpm.attrs["units"], survey.eccentricity.attrs["units"]) == ("rpm", "m")
    assert {name: survey.attrs[f"machine_{name}"] for name in GEARS} == GEARS
    assert survey.attrs["machine_drive"] == request.machine.drive
    np.testing.assert_allclose(survey.rpm[[0, -1]], [6000.0, 1500.0], rtol=1e-14)
    np.testing.assert_allclose(survey.eccentricity, np.linspace(2e-6, 60e-6, 4), rtol=1e-13)
    for i, j in np.ndindex(request.shape):
        at = {"eccentricity": float(survey.eccentricity[i]), "rpm": float(survey.rpm[j])}
        machine = rattle.Machine(**GEARS, **at, drive=request.machine.drive)
        assert machine.delta == pytest.approx(float(survey.delta[j]), rel=1e-14)
        assert machine.epsilon == pytest.approx(float(survey.epsilon[i]), rel=1e-14)
        gear = rattle.Gear(float(survey.delta[j]), float(survey.epsilon[i]), machine.beta)
        quiet = sum(each.fraction for each in gear.attractors(8, "natural") if each.kind == "quiet")
        assert float(survey.quiet_fraction[i, j]) == quiet
    assert SurveyRequest.model_validate_json(survey.attrs["request"]) == request
    slow = survey.swap_dims(delta="rpm", epsilon="eccentricity").sel(rpm=1500, eccentricity=2e-6, method="nearest")
    assert float(slow.quiet_fraction) == 1.0


def test_other_formats_have_them_too(stored: tuple[SurveyRequest, Path]) -> None:
    _request, path = stored
    survey = xr.open_zarr(path, chunks=None)
    with write_netcdf(survey) as file, xr.open_dataset(file) as read:
        assert read.quiet_fraction.coords["rpm"].dims == ("delta",)
        assert read.attrs["machine_radius"] == 0.05
        np.testing.assert_array_equal(read.eccentricity, survey.eccentricity)


def test_a_table_has_speeds_and_eccentricities_beside_the_models(stored: tuple[SurveyRequest, Path]) -> None:
    request, path = stored
    with xr.open_zarr(path, chunks=None) as survey:
        rows = list(csv.DictReader(io.StringIO("".join(csv_lines(survey)))))
        assert list(rows[0])[:5] == ["delta", "epsilon", "beta", "rpm", "eccentricity"]
        assert len(rows) == request.n_cells
        for number, row in enumerate(rows):
            cell = survey.isel(epsilon=number // 3, delta=number % 3)
            assert (float(row["rpm"]), float(row["eccentricity"])) == (cell.rpm, cell.eccentricity)
            assert float(row["quiet_fraction"]) == cell.quiet_fraction


def test_a_picture_has_speed_and_eccentricity_as_axes_rising_to_the_right_and_upwards(
    stored: tuple[SurveyRequest, Path],
) -> None:
    request, path = stored
    survey = xr.open_zarr(path, chunks=None)
    for figure in (draw_map_figure(survey, "quiet_fraction"), survey_figure(survey)):
        axes = figure.axes[0]
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("speed, rpm", "eccentricity, µm")
        for axis, method, per in ((axes.xaxis, "speed_at_damping", 1.0), (axes.yaxis, "eccentricity_in_metres", 1e6)):
            shown = [float(label.get_text()) for label in axis.get_ticklabels()]
            of_machine = getattr(request.machine, method)(np.array(axis.get_ticklocs())) * per
            np.testing.assert_allclose(of_machine, shown, rtol=1e-6)
            assert len(shown) >= 3
        left, right = axes.get_xlim()
        assert request.machine.speed_at_damping(left) < request.machine.speed_at_damping(right)
        assert axes.get_ylim()[0] < axes.get_ylim()[1]
        beside = {each.get_xlabel() + each.get_ylabel() for each in axes.child_axes}
        assert beside == {"damping δ", "eccentricity ε"}
    watched = draw_map_figure(survey, "watched_periods")
    assert "forcing period" not in watched.axes[0].get_title() + watched.axes[1].get_ylabel()
    assert "revolutions" in watched.axes[1].get_ylabel()
    window = MapPictureOptions(delta=(float(survey.delta[0]), float(survey.delta[1])), epsilon=(0.0, 5e-4))
    drawing = render_map_picture(survey, "region", look=window, form="svg").decode()
    for said in ("speed, rpm", "eccentricity, µm", "damping δ", "eccentricity ε"):
        assert f"<!-- {said} -->" in drawing


def test_ticks_are_round_numbers() -> None:
    assert tick_values(1000.0, 3000.0) == [1000.0, 1500.0, 2000.0, 2500.0, 3000.0]
    assert tick_values(80.0, 10000.0) == [100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 10000.0]
    assert tick_values(0.0, 0.06) == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06])


def test_a_finer_window_is_of_the_same_machine(stored: tuple[SurveyRequest, Path]) -> None:
    request, _path = stored
    delta, epsilon = request.delta, request.epsilon
    window = request_for_window(request, Window((delta.start, delta.stop), (epsilon.start, epsilon.stop)), (3, 4))
    assert window.machine == request.machine


def test_axes_of_the_model_have_a_machines_numbers_too() -> None:
    axes = {"delta": Axis(start=0.3, stop=0.5, num=2), "epsilon": Axis(start=0.0, stop=3e-3, num=2)}
    request = request_of(**axes, machine=GEARS)
    assert request.beta == pytest.approx(0.001)
    assert request.machine.speed_at_damping(request.delta.values()) == pytest.approx([3333.3333, 2000.0])
    assert SurveyRequest.model_validate(request.model_dump()) == request
    assert request.content_hash() != request_of(**axes, beta=request.beta, machine=None).content_hash()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"delta": {"start": 0.1, "stop": 0.2, "num": 2}}, "machine.rpm and delta describe the same axis"),
        ({"beta": 0.6}, "the gears of this machine have beta 0.001: leave beta out"),
        ({"machine": GEARS | SPANS | {"radius": 50.0}}, "for 50 mm give 0.05"),
        ({"machine": GEARS | SPANS | {"backlash": 0.1}}, "for 0.1 mm give 0.0001"),
        ({"machine": GEARS | SPANS | {"inertia": "heavy"}}, 'machine.inertia: must be a number, got "heavy"'),
        ({"machine": {"inertia": 1.0} | SPANS}, "machine.drag: is not given"),
        ({"machine": GEARS | {"rpm": SPANS["rpm"]}}, "epsilon"),
        ({"machine": GEARS | SPANS | {"rpm": {"start": 0.0, "stop": 10.0, "num": 3}}}, "rpm must be greater than 0"),
        ({"machine": GEARS | SPANS | {"rpm": 3000}}, "machine.rpm: an axis needs start"),
        ({"model": "stiff", "kappa": 1e4, "quantities": ("region",)}, "kappa of a machine changes with its speed"),
        ({"machine": GEARS | SPANS | {"stiffness": 1e8}}, "machine.stiffness: is not a known field"),
    ],
)
def test_what_cannot_be_meant_is_refused(changed: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError) as refused:
        request_of(**changed)
    assert message in str(refused.value)


#: Two gears at the ends of double precision: what is made of them is 0 or infinite.
EXTREME = {"inertia": 5e-324, "drag": 5e-324, "radius": 1e-160, "driven_inertia": 1e-3, "driven_drag": 1e300}


@pytest.mark.parametrize(
    "changed",
    [
        EXTREME,
        EXTREME | {"drive": "speed"},
        EXTREME | {"radius": 0.05},
        EXTREME | {"inertia": 0.003},
        EXTREME | {"driven_inertia": 5e-324},
        {"radius": 5e-324, "driven_radius": 1.0, "teeth": 1, "driven_teeth": 1},
    ],
)
def test_gears_too_far_apart_are_refused(changed: dict[str, object]) -> None:
    machine = GEARS | SPANS | changed
    with pytest.raises(ValidationError):
        request_of(machine=machine)
    with pytest.raises(rattle.ParameterError):
        rattle.Machine(**machine | {"rpm": 3000.0, "eccentricity": 0.0})
