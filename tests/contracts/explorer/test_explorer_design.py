"""What a designer gives and gets on the page: machines in SI units, tolerances, design limits, sounds."""

import asyncio
import io
from base64 import b64decode
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import wavfile
from service_support import no_cluster
from test_explorer_point import new_view
from waiting import eventually

import rattle
from gear_rattle.service.app import create_app
from gear_rattle.service.errors import UnavailableError
from gear_rattle.service.explorer.common.point_state import PointTabsState, PointTolerances
from gear_rattle.service.explorer.design import rattling, tolerance
from gear_rattle.service.explorer.design.tolerance import RADIUS
from gear_rattle.service.explorer.point import loudness, parts
from gear_rattle.service.explorer.state.events import SoundRequested, TabChosen
from gear_rattle.service.operations import design_limits
from gear_rattle.service.operations.design_limits import DesignLimits, dampings_coarse_first
from gear_rattle.service.settings import Settings
from gear_rattle.service.state import ApplicationState
from rattle.intensity import natural_energy
from rattle.models import AnyGear, Impacting, Stiff

MACHINE = rattle.Machine(0.003, 5e-4, 100e-6, 15e-6, 0.05, rpm=3000)


def with_front(data: Path, body: Callable[[ApplicationState], Awaitable[None]]) -> None:
    async def main() -> None:
        app = create_app(Settings(data=data, preload=False, explorer=False), no_cluster)
        async with app.router.lifespan_context(app):
            await body(app.state.front)

    asyncio.run(main())


def test_an_ellipse_holds_95_of_100_gears() -> None:
    rng = np.random.default_rng(1)
    inside = np.hypot(*rng.standard_normal((2, 200_000))) < RADIUS
    assert inside.mean() == pytest.approx(0.95, abs=2e-3)
    line = tolerance.tolerance_outline(0.6, 0.1, None, PointTolerances(0.02, 0.01, 0.9))
    away = np.hypot((line[:, 0] - 0.6) / 0.02, (line[:, 1] - 0.1) / 0.01)
    np.testing.assert_allclose(away, RADIUS, rtol=1e-12)


def test_the_ellipse_of_a_machine_is_one_of_speed_and_eccentricity() -> None:
    line = tolerance.tolerance_outline(MACHINE.delta, MACHINE.epsilon, MACHINE, PointTolerances(100.0, 2e-6, 0.9))
    rpm = 60.0 * MACHINE.drag / (MACHINE.inertia * line[:, 0])
    eccentricity = line[:, 1] * MACHINE.radius
    np.testing.assert_allclose(np.hypot((rpm - 3000) / 100, (eccentricity - 15e-6) / 2e-6), RADIUS, rtol=1e-9)
    far = tolerance.tolerance_outline(0.6, 0.01, None, PointTolerances(10.0, 10.0, 0.9))
    assert far.min() >= 0.0  # cut off where no gears are
    assert far[:, 0].min() > 0.0


@pytest.mark.parametrize(
    ("gear", "quiet"),
    [(rattle.Gear(0.6, 0.03), 1.0), (rattle.Gear(0.6, 0.25), 0.0), (Stiff(0.6, 1e4).gear(0.6, 0.03), 1.0)],
)
def test_the_yield_where_it_is_known(gear: AnyGear, quiet: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Impacting, "design_gears", 64)
    monkeypatch.setattr(Stiff, "design_gears", 8)
    found = tolerance.compute_yield(gear, None, PointTolerances(0.005, 0.001, 0.9))
    assert (found.quiet.value, found.passing.value) == (quiet, quiet)
    assert f"{100 * quiet:.1f} % [" in tolerance.describe_yield(found, 0.9)


def test_the_yield_of_a_machine_is_that_of_its_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    given = tolerance.numbers_with_tolerances(MACHINE.gear, MACHINE, PointTolerances(0.0, 3e-6, 0.9))
    assert given["rpm"] == pytest.approx(3000)
    assert given["eccentricity"] == rattle.Normal(15e-6, 3e-6, low=0.0)
    assert (given["backlash"], given["drive"]) == (100e-6, "torque")
    with pytest.raises(rattle.ParameterError, match="nothing varies"):
        tolerance.compute_yield(MACHINE.gear, MACHINE, PointTolerances(0.0, 0.0, 0.9))
    monkeypatch.setattr(Impacting, "design_gears", 128)
    monkeypatch.setattr(tolerance, "MOST_JUDGED", 1)
    found = tolerance.compute_yield(MACHINE.gear, MACHINE, PointTolerances(0.0, 1e-9, 0.9))
    shares = {each.kind: each.fraction for each in MACHINE.attractors(1024)}
    assert found.quiet.low - 0.03 < shares["quiet"] < found.quiet.high + 0.03


def test_a_design_limit_is_found_once_coarse_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[float] = []

    async def here(_front: ApplicationState, work: Callable[..., Any], *arguments: Any, **_: Any) -> Any:
        asked.append(arguments[1])
        return work(*arguments)

    async def body(front: ApplicationState) -> None:
        monkeypatch.setattr(design_limits, "compute_in_process", here)
        monkeypatch.setattr(design_limits, "COUNT", 64)
        monkeypatch.setattr(design_limits, "DAMPINGS", 5)
        known = DesignLimits(front)
        drawn = [found async for found in known.limits_over_damping(Impacting(0.6), (0.5, 0.9), 0.8)]
        assert [delta.size for delta, _ in drawn] == [1, 2, 3, 4, 5, 5]
        assert asked == pytest.approx([0.5, 0.9, 0.7, 0.6, 0.8])
        delta, found = drawn[-1]
        assert np.all(np.diff(delta) > 0)
        exact = rattle.design_limit({"delta": 0.7, "beta": 0.6}, "epsilon", 0.8, count=64)
        np.testing.assert_array_equal(found[:, 2], exact)
        again = [delta.size async for delta, _ in known.limits_over_damping(Impacting(0.6), (0.5, 0.9), 0.8)]
        assert (again, len(asked)) == ([5], 5)

    with_front(tmp_path, body)


def test_every_value_of_a_limit_is_looked_at_once() -> None:
    found = dampings_coarse_first((0.4, 1.0))
    assert len(found) == len(set(found)) == design_limits.DAMPINGS
    assert sorted(found) == np.linspace(0.4, 1.0, design_limits.DAMPINGS).tolist()


def test_intensities_are_told_in_both_units() -> None:
    attractors = MACHINE.attractors(64)
    found = rattling.motion_intensities(MACHINE.gear, attractors)
    loud = next(i for i, each in enumerate(attractors) if each.n_plus == 2)
    si, plain = (
        loudness.intensity_table(attractors, found, MACHINE.delta, machine, loudness.Palette())
        for machine in (MACHINE, None)
    )
    power = MACHINE.intensity(attractors[loud]).power
    assert f"<td>{loudness.number_text(power)}</td>" in si
    assert "<td>100</td>" in si  # impacts a second, as in docs/engineers.md
    assert "<td>103.2</td>" in si
    assert f"<td>{loudness.number_text(found[loud].energy)}</td>" in plain  # type: ignore[union-attr]
    said = loudness.describe_loudest_motion(attractors, found, MACHINE.delta, None)
    assert "0 dB is the energy of one impact of speed 2πδ in each forcing period" in said
    natural = rattle.Gear(0.6, 0.1)
    (c,) = (each for each in natural.orbits() if each.name == "C")
    assert natural.intensity(c).level(natural_energy(0.6)) == pytest.approx(0.0, abs=1e-9)
    assert c.v == pytest.approx(2 * np.pi * 0.6)
    assert 'title="0 dB: the energy of one impact' in plain
    lost = replace(attractors[loud], tau=0.1, v=1.0)
    assert rattling.motion_intensities(MACHINE.gear, (lost,)) == (None,)


def test_a_machine_s_point_is_told_in_si_and_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def quick(work: Callable[..., Any], *arguments: Any) -> Any:
        if work in (
            parts.compute_basins,
            parts.compute_plane_lines,
            parts.compute_quiet_margin,
            parts.compute_diagram_contents,
        ):
            raise UnavailableError("not in this test")
        return work(*((arguments[0], 64) if work is parts.sampled_attractors else arguments))

    async def body(front: ApplicationState) -> None:
        state = PointTabsState(tolerance=PointTolerances(0.0, 1e-6, 0.9))
        view = new_view(front, MACHINE.delta, MACHINE.epsilon, Impacting(MACHINE.beta), MACHINE, state=state)
        panel, dispatch = view.panel, view.store.dispatch

        async def compute(work: Any, *arguments: Any, **_: Any) -> Any:
            return quick(work, *arguments)

        monkeypatch.setattr(view.work, "compute", compute)
        monkeypatch.setattr(Impacting, "design_gears", 16)
        assert "A machine at 3000 rpm with an eccentricity of 15 µm" in panel.quiet_limit_text.html
        await eventually(lambda: "J per revolution" in panel.intensities_text.html)
        assert "dB re 1 pW" in panel.loudest_motion_text.html
        dispatch(TabChosen("motion"))
        await eventually(lambda: "exact lines" in panel.under_spectrum.html)
        lines = panel.spectrum.lines.data
        np.testing.assert_allclose(lines["x"][:3], [0.0, 50.0, 100.0])
        assert lines["y"][0] == pytest.approx(4 * np.pi * MACHINE.delta * MACHINE.units.force)  # carries the drag
        await eventually(lambda: "of the gears pass" in panel.visible_tolerance_fields.said.html)
        assert panel.rpm_field.value == 3000
        dispatch(SoundRequested(1500.0))
        await eventually(lambda: "<audio" in panel.sound_text.html)
        data = b64decode(panel.sound_text.html.split("base64,")[1].split('"')[0])
        rate, heard = wavfile.read(io.BytesIO(data))
        assert heard.size == rattling.SECONDS * rate
        assert np.abs(heard).max() > 20_000
        dispatch(SoundRequested(None))
        await eventually(lambda: "above 0 rpm" in panel.sound_text.html)
        first, second, _ = panel.visible_tolerance_fields.widgets
        assert (first.label, second.label, second.value) == ("σ of speed, rpm", "σ of eccentricity, µm", 1.0)
        second.value = 2.0
        panel.visible_tolerance_fields.request_yield()
        assert view.store.view.point_state == PointTabsState(tolerance=PointTolerances(0.0, 2e-6, 0.9), tab="motion")
        second.value = None
        panel.visible_tolerance_fields.request_yield()
        assert "needs a number" in panel.visible_tolerance_fields.said.html
        view.stop()

    with_front(tmp_path, body)
