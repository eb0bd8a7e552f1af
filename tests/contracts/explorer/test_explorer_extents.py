"""The eccentricities between which the motions of a point attract are those of the closed forms, and are said in words.

Expected values: SN1 and the flip of C in closed form, G1 from its equation, SN2 and PD1 as curves, the boundary crisis.
"""

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest
from test_explorer_point import new_view, with_front
from waiting import eventually

import rattle
from gear_rattle.service.explorer.design.extents import (
    CRISIS,
    FLIP,
    GRAZING,
    QUIET_LIMIT,
    RANGE,
    SADDLE_NODE,
    SWEPT,
    ExtentEnd,
    MotionExtent,
    add_crisis_to_extents,
    epsilon_extent_of_motion,
    epsilon_search_range,
    has_bracketed_chaos_end,
)
from gear_rattle.service.explorer.point import parts, words
from gear_rattle.service.explorer.point.point_diagram import diagram_table_html
from gear_rattle.service.state import ApplicationState
from rattle.crisis import boundary_crisis
from rattle.curves import trace
from rattle.models import Impacting, Stiff
from rattle.plot import Palette

C, D = (1, 1, 0), (1, 1, 1)
MAP = (0.0, 0.3)


def extent_of(gear: rattle.Gear, label: tuple[int, int, int]) -> MotionExtent:
    orbit = next(each for each in gear.orbits() if each.stable and (each.m, each.n_plus, each.n_minus) == label)
    found = gear.reached([orbit.tau], [orbit.v]).attractors[0]
    extent = epsilon_extent_of_motion(gear, found, epsilon_search_range(gear, MAP))
    assert extent is not None
    return extent


@pytest.mark.parametrize(("delta", "epsilon", "beta"), [(0.6, 0.1, 0.6), (0.45, 0.12, 0.6), (0.7, 0.2, 1.2)])
def test_c_begins_at_sn1_and_ends_at_its_flip_or_its_graze(delta: float, epsilon: float, beta: float) -> None:
    gear = rattle.Gear(delta, epsilon, beta)
    low, high = extent_of(gear, C)[:2]
    assert (low.kind, low.curve, low.error) == (SADDLE_NODE, "SN1", 0.0)
    assert low.epsilon == pytest.approx(gear.sn1, abs=1e-10)
    if gear.flip is not None:
        assert (high.kind, high.curve, high.remains) == (FLIP, "PDC", True)
        assert high.epsilon == pytest.approx(gear.flip, abs=1e-10)
    else:
        assert (high.kind, high.curve) == (GRAZING, "G1")
        assert high.epsilon == pytest.approx(float(rattle.grazing("G1", delta, beta).epsilon), abs=1e-10)


@pytest.mark.parametrize(("delta", "epsilon", "beta"), [(0.6, 0.072, 0.6), (0.7, 0.2, 1.2)])
def test_d_begins_at_sn2_and_loses_stability_at_pd1(delta: float, epsilon: float, beta: float) -> None:
    window = (delta - 0.1, delta + 0.1), (0.01, 0.4)
    low, high = extent_of(rattle.Gear(delta, epsilon, beta), D)[:2]
    for end, kind, curve in ((low, SADDLE_NODE, "SN2"), (high, FLIP, "PD1")):
        assert (end.kind, end.curve) == (kind, curve)
        assert min(abs(end.epsilon - each) for each in trace(curve, beta, *window).at(delta)) < 1e-9
    assert high.remains


def test_quiet_ends_at_the_quiet_limit() -> None:
    gear = rattle.Gear(0.6, 0.1)
    quiet = next(each for each in gear.attractors(64) if each.kind == "quiet")
    low, high = epsilon_extent_of_motion(gear, quiet, (0.0, 0.3))[:2]  # type: ignore[index]
    assert (low.kind, low.epsilon) == (RANGE, 0.0)
    assert (high.kind, high.epsilon) == (QUIET_LIMIT, rattle.quiet_limit(0.6))
    assert epsilon_extent_of_motion(gear, replace(quiet, kind="undecided"), (0.0, 0.3)) is None


@pytest.mark.parametrize(("delta", "epsilon"), [(0.6, 0.1), (0.7, 0.095)])
def test_chaos_is_swept_to_a_bracket_and_ends_in_the_crisis(delta: float, epsilon: float) -> None:
    gear = rattle.Gear(delta, epsilon)
    found = gear.attractors(256)
    chaotic = next(each for each in found if each.kind == "chaotic")
    extent = epsilon_extent_of_motion(gear, chaotic, (0.0, 0.3))
    assert extent is not None
    crisis = boundary_crisis(delta).epsilon
    assert extent.high.kind == SWEPT
    assert extent.high.motion_beyond in ("quiet", "undecided")  # the first transients are long
    assert abs(extent.high.epsilon - crisis) < 2 * extent.high.error < 2e-4
    assert has_bracketed_chaos_end([chaotic], [extent])
    (exact,) = add_crisis_to_extents(gear, [chaotic], [extent])
    assert exact is not None
    assert (exact.high.kind, exact.high.epsilon, exact.high.error) == (CRISIS, crisis, 0.0)
    assert not has_bracketed_chaos_end([chaotic], [exact])
    low = extent.low
    assert low.kind == SWEPT
    below, above = (
        {each.kind for each in rattle.Gear(delta, low.epsilon + shift).attractors(512)} for shift in (-2e-3, 2e-3)
    )
    assert "chaotic" in above
    assert "chaotic" not in below


def test_a_motion_is_swept_where_no_branch_is_known() -> None:
    """The inelastic gear has no branches: its C is found between its saddle-node and its flip within the bracket."""
    gear = rattle.Gear(0.6, 0.15, 0.6, restitution=0.9)
    orbit = next(each for each in gear.orbits() if each.stable)
    found = gear.reached([orbit.tau], [orbit.v]).attractors[0]
    extent = epsilon_extent_of_motion(gear, found, (0.0, 0.3))
    assert extent is not None
    assert extent.low.kind == SWEPT
    assert abs(extent.low.epsilon - gear.sn1) < 2 * extent.low.error


def test_a_stiff_motion_goes_on_beyond_its_graze() -> None:
    gear = Stiff(0.6, 1e4).gear(0.6, 0.08)
    orbit = next(each for each in gear.orbits() if each.stable and each.n_minus == 0)
    found = gear.reached([orbit.tau], [orbit.v]).attractors[0]
    low, high = epsilon_extent_of_motion(gear, found, (0.0, 0.3))[:2]  # type: ignore[index]
    assert (low.kind, low.curve) == (SADDLE_NODE, "SN1")
    assert low.epsilon == pytest.approx(gear.sn1, abs=1e-9)
    assert (high.kind, high.motion_beyond) == (GRAZING, "P(1,1,1)")
    assert words.extent_end_in_words(high, True).endswith("ends at a graze (above, P(1,1,1))")


@pytest.mark.parametrize(
    ("end", "is_upper", "said"),
    [
        (ExtentEnd(SADDLE_NODE, 0.0903456, curve="SN1"), False, "0.09035: begins by a saddle-node (SN1)"),
        (ExtentEnd(FLIP, 0.12, remains=True), True, "0.12: loses stability by period doubling"),
        (ExtentEnd(FLIP, 0.12, remains=True), False, "0.12: becomes stable by period doubling"),
        (ExtentEnd(FLIP, 0.12), False, "0.12: begins by period doubling"),
        (ExtentEnd(GRAZING, 0.12), True, "0.12: ends at a graze"),
        (ExtentEnd(RANGE, 0.3), True, "does not end up to 0.3"),
        (
            ExtentEnd(SWEPT, 0.097, 0.0004, motion_beyond="P(2,2,0)"),
            False,
            "0.0970 ± 0.0004 (swept); below it the sweep found P(2,2,0)",
        ),
        (ExtentEnd(CRISIS, 0.11088676), True, "0.1109: ends in the boundary crisis"),
    ],
)
def test_an_end_is_said_in_words(end: ExtentEnd, is_upper: bool, said: str) -> None:
    assert words.extent_end_in_words(end, is_upper) == said


def test_a_machine_has_its_ends_in_micrometres() -> None:
    machine = rattle.Machine(0.003, 5e-4, 100e-6, 15e-6, 0.05, rpm=3000)
    found = parts.sampled_attractors(machine.gear, 64)
    number = next(i for i, each in enumerate(found.attractors) if each.kind == "quiet")
    extents = [
        MotionExtent(ExtentEnd(RANGE, 0.0), ExtentEnd(QUIET_LIMIT, machine.gear.quiet_limit)) for _ in range(number + 1)
    ]
    said = words.extents_table(found, extents, machine, Palette())
    assert "To µm" in said
    limit = words.number_text(1e6 * machine.gear.quiet_limit * machine.units.length)
    assert f"{limit}: ends at the quiet limit" in said


def test_the_events_list_the_beginning_and_the_end_of_chaos() -> None:
    gear = rattle.Gear(0.6, 0.1)
    attractors = gear.attractors(64)
    extents = [
        MotionExtent(ExtentEnd(SWEPT, 0.0977, 0.0001, motion_beyond="P(2,2,0)"), ExtentEnd(CRISIS, 0.1109))
        if each.kind == "chaotic"
        else None
        for each in attractors
    ]
    chaos = words.chaos_events(gear, attractors, extents)
    assert [each[0] for each in chaos] == ["beginning of chaos", "end of chaos"]
    found = parts.compute_diagram_contents(gear, "epsilon", 1e-3, steps=4, count=4)
    said = diagram_table_html(found, chaos)
    assert "Of which motion" in said
    assert 'data-point="0.6,0.0977"' in said
    assert said.index("beginning of chaos") < said.index("end of chaos")
    assert "beginning of chaos" not in diagram_table_html(found._replace(direction="delta"), chaos)


def test_the_answer_says_where_each_motion_begins_and_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def body(front: ApplicationState) -> None:
        view = new_view(front, 0.6, 0.089, Impacting(0.6))

        async def here(work, *arguments, **_):  # type: ignore[no-untyped-def]
            await asyncio.sleep(0)
            return work(*((arguments[0], 256) if work is parts.sampled_attractors else arguments))

        monkeypatch.setattr(view.work, "compute", here)
        await eventually(lambda: "P(4,4,2)" in view.panel.extents.html)
        said = view.panel.extents.html
        assert view.panel.likelihood_text.html  # the answer does not wait for it
        assert "ends at the quiet limit" in said
        assert "begins by a saddle-node (SN1)" in said
        view.stop()

    with_front(tmp_path, body, preload=False)
