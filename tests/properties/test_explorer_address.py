"""The address of a view: read back it is the same view, and no address is an error."""

from urllib.parse import parse_qs

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import rattle
from gear_rattle.service.explorer.common.address import FURTHER, LIMITS, OVERLAYS, THEMES, EnteredMachine, View
from gear_rattle.service.explorer.common.point_state import TABS, PointTabsState, PointTolerances
from gear_rattle.service.explorer.design import axes
from gear_rattle.workers.pictures.look import USUAL_SHARE

numbers = st.floats(-1e3, 1e3)
windows = st.tuples(numbers, numbers).filter(lambda pair: pair[0] < pair[1])
words = st.from_regex(r"[a-z][a-z_0-9]{0,20}", fullmatch=True)


def is_machine(entered: EnteredMachine) -> bool:
    """Return whether these numbers make a machine; an address forgets others."""
    try:
        return entered.machine.gear is not None
    except rattle.RattleError:
        return False


machines = st.builds(
    EnteredMachine,
    inertia=st.floats(1e-4, 1e-2),
    drag=st.floats(1e-6, 1e-2),
    backlash=st.floats(1e-6, 1e-3),
    eccentricity=st.floats(0.0, 1e-4),
    radius=st.floats(0.02, 0.1),
    rpm=st.floats(1.0, 1e4),
    drive=st.sampled_from(("torque", "speed")),
    stiffness=st.none() | st.floats(1e6, 1e9),
    restitution=st.none() | st.floats(0.1, 1.0),
    load_torque=st.none() | st.floats(0.0, 10.0),
    mesh_error=st.none() | st.floats(0.0, 1e-6),
    mesh_error_2=st.none() | st.floats(0.0, 1e-6),
    mesh_error_3=st.none(),
    teeth=st.none() | st.integers(8, 60).map(float),
    driven_teeth=st.none(),
    driven_inertia=st.none() | st.floats(1e-4, 1e-2),
    driven_drag=st.none() | st.floats(1e-6, 1e-2),
    driven_radius=st.none(),
    driven_eccentricity=st.none() | st.floats(0.0, 1e-4),
).filter(is_machine)
shares = st.floats(0.0, 1.0)
states = st.builds(
    PointTabsState,
    attractor=st.none() | st.integers(0, 999),
    start=st.none() | st.tuples(st.floats(0.0, 1.0, exclude_max=True), st.floats(1e-6, 10.0)),
    direction=st.sampled_from(("epsilon", "delta")),
    span=st.none() | st.floats(1e-7, 0.5),
    to=st.none() | st.tuples(st.floats(1e-3, 10.0), st.floats(0.0, 10.0)),
    tolerance=st.none() | st.builds(PointTolerances, shares, shares, shares),
    at=st.none() | shares,
    tab=st.none() | st.sampled_from(TABS),
).map(PointTabsState.with_changes)
views = st.builds(
    View,
    survey=words,
    variable=words,
    index=st.integers(0, 64),
    slice=st.integers(0, 64),
    limits=st.sampled_from(LIMITS) | windows,
    log=st.booleans(),
    overlays=st.none()
    | st.sets(st.sampled_from(OVERLAYS)).map(lambda chosen: tuple(n for n in OVERLAYS if n in chosen)),
    delta=st.none() | windows.filter(lambda pair: pair[1] > 0),
    epsilon=st.none() | windows,
    point=st.tuples(st.floats(1e-3, 10.0), st.floats(0.0, 10.0)),
    machine=st.none() | machines,
    share=st.floats(0.01, 0.9999) | st.just(USUAL_SHARE),
    theme=st.sampled_from(("", *THEMES)),
    point_state=states,
)


@given(views)
def test_an_address_reproduces_its_view(view: View) -> None:
    query = {name: [value.encode() for value in values] for name, values in parse_qs(view.query()[1:]).items()}
    assert View.parse(query) == view


names = (
    *("survey", "variable", "index", "slice", "limits", "log", "overlays"),
    *("delta", "epsilon", "point", "machine", "share", "theme"),
    *("profile", "profile_limits", "pins", *FURTHER),
)
nonsense = st.binary(max_size=30) | st.sampled_from((b"nan,1", b"1,2", b"1e400,2", b"-1,-2", b"9" * 5000))


@example({"p.": [b""]})
@example({"pins": [b"0.6,0.1,0.6,1e4,5"]})
@example({"p.tab": [b"basins"]})  # of no point
@given(st.dictionaries(st.sampled_from(names) | st.text(max_size=5), st.lists(nonsense, max_size=2)))
def test_no_address_is_an_error(query: dict[str, list[bytes]]) -> None:
    view = View.parse(query)
    assert View.parse({k: [v[0].encode()] for k, v in parse_qs(view.query()[1:]).items()}) == view
    assert view.theme in ("", *THEMES)


@given(st.floats(1e-4, 1e4), st.floats(1e-12, 1e-6))
def test_labels_of_a_narrow_axis_are_exact(middle: float, relative: float) -> None:
    low, high = middle * (1 - relative), middle * (1 + relative)
    found = axes.tick_label_offset((low, high))
    assert found is not None
    offset, power = found
    assert abs(offset - middle) <= high - low
    assert 0.9 <= (high - low) / 10.0**power <= 10.3
    ticks = np.linspace(low, high, 100)
    assert len({axes.coordinate_text(float(tick), (low, high)) for tick in ticks}) == 100 or relative < 1e-11


def test_wide_axes_have_no_offset() -> None:
    assert axes.tick_label_offset((0.4, 1.0)) is None
    assert axes.tick_label_offset((0.0, 1e-9)) is None


@pytest.mark.parametrize("name", ["delta", "point", "limits"])
def test_a_window_the_wrong_way_round_is_left_out(name: str) -> None:
    assert View.parse({name: [b"2,-1"]}) == View()
