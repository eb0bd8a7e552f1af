"""Colours that mean something else are told apart, by people without green cones too; viewers say what they span."""

from functools import partial
from itertools import combinations, pairwise
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr
from bokeh.colors import RGB
from colour_difference import difference, lab_of

from gear_rattle.service.explorer.common.address import DrawnMapSettings, View
from gear_rattle.service.explorer.common.figures import INK, LEAST_CONTRAST, line_colour
from gear_rattle.service.explorer.map.controls import LIMIT_NAMES, LOG, OWN, MapControls, parse_entered_limits
from gear_rattle.service.explorer.places.example import REQUEST
from gear_rattle.service.explorer.state.events import MapDrawn
from gear_rattle.service.explorer.state.store import PageStore
from gear_rattle.workers.pictures.largest import FLAG_COLOURS, family_colours
from gear_rattle.workers.pictures.look import AMONG, LARGEST
from gear_rattle.workers.pictures.maps import COLOURS_OF_KINDS, colours_of_codes
from rattle import KINDS
from rattle.plot.colours import NAMED, REGION_COLOURS, Palette, colour
from rattle.plot.plane import STYLES


@pytest.mark.parametrize(
    ("one", "other", "published"),
    [
        ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
        ((50, 2.5, 0), (73, 25, -18), 27.1492),
        ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
    ],
)
def test_the_difference_is_that_of_its_paper(
    one: tuple[float, ...], other: tuple[float, ...], published: float
) -> None:
    assert difference(np.array(one), np.array(other)) == pytest.approx(published, abs=5e-5)


def test_families_that_follow_one_another_are_told_apart() -> None:
    labels = [(1, 1, 0), (1, 2, 0), (1, 3, 0), (3, 3, 2), (1, 1, 1), (1, 4, 0), (1, 1, 1), (2, 4, 0), (2, 2, 1)]
    labels += [(1, 5, 0), (2, 3, 1), (2, 2, 2), (2, 3, 1), (2, 3, 2), (4, 4, 3), (4, 4, 2), (4, 4, 2), (2, 2, 0)]
    labels += [(1, 5, 0), (1, 5, 0), (2, 3, 2), (8, 8, 4), (4, 4, 2)]
    periodic = KINDS.index("periodic")
    rows = [(KINDS.index("quiet"), 0, 0, 0), (KINDS.index("chaotic"), 0, 0, 0), *((periodic, *each) for each in labels)]
    columns = zip(("kind", "m", "n_plus", "n_minus"), zip(*rows, strict=True), strict=True)
    colours = family_colours(xr.Dataset({name: ("family", list(values)) for name, values in columns}))
    seen = [lab_of(each, as_seen=np.eye(3)) for each in colours]
    assert min(difference(*pair) for pair in pairwise(seen)) > 12
    assert min(difference(*pair) for pair in combinations(seen, 2)) > 7


def test_quiet_has_one_colour_and_no_rattle_is_near_it() -> None:
    quiet = colour("quiet")
    kinds = dict(zip(KINDS, COLOURS_OF_KINDS, strict=True))
    assert kinds["quiet"] == quiet
    for seen in (partial(lab_of, as_seen=np.eye(3)), lab_of):
        assert min(difference(*map(seen, pair)) for pair in combinations(kinds.values(), 2)) > 20
    rng = np.random.default_rng(11)
    types = [tuple(map(int, each)) for each in rng.integers(1, 30, (400, 3))]
    palette = Palette()
    rattling = [palette.colour(each) for each in (*NAMED, *types)]  # with colours by rule and spare colours
    for seen, least in ((partial(lab_of, as_seen=np.eye(3)), 20), (lab_of, 10)):
        assert min(difference(seen(quiet), seen(each)) for each in rattling) > least


@pytest.mark.parametrize(("among", "same"), [("all", False), ("rattling", True)])
def test_the_map_of_families_shows_only_quiet_cells_as_quiet(among: str, same: bool) -> None:
    attributes = {"flag_meanings": "none quiet 1:_chaos", FLAG_COLOURS: f"#f4efe3 {colour('quiet')} #d7191c"}
    plane = xr.DataArray(np.zeros((2, 2)), coords={AMONG: among}, dims=("epsilon", "delta"), attrs=attributes)
    colours = colours_of_codes(plane.rename(LARGEST))
    assert (colours[0] == colours[1]) == same


def test_regions_and_lines_are_told_apart_without_green() -> None:
    paper = dict(zip(("I", "II", "III", "IV", "V"), map(lab_of, REGION_COLOURS[1:6]), strict=True))
    assert difference(paper["III"], paper["V"]) > 20
    assert min(difference(one, other) for one, other in combinations(paper.values(), 2)) > 14
    colours = {name: lab_of("#000000" if colour == "black" else colour) for name, (colour, _) in STYLES.items()}
    for one, other in combinations(STYLES, 2):
        if STYLES[one][0] != STYLES[other][0]:
            assert difference(colours[one], colours[other]) > 20
        else:
            assert STYLES[one][1] != STYLES[other][1]  # of one kind: dashes tell them apart


def test_limits_of_a_viewer_s_own_are_refused_in_words() -> None:
    assert parse_entered_limits(None, 1.0, False) == "Enter two numbers as colour limits."  # a field that was emptied
    assert "cannot span -2 to -3" in parse_entered_limits(-2.0, -3.0, False)
    assert "the second limit must be above 0, not -1" in parse_entered_limits(-2.0, -1.0, True)
    assert parse_entered_limits(-2.0, -1.0, False) == (-2.0, -1.0)
    assert parse_entered_limits(-2.0, 1.0, True) == (-2.0, 1.0)


def test_own_limits_begin_with_those_of_the_colours_that_are_seen() -> None:
    assert next(iter(LIMIT_NAMES)) == View().limits
    store = PageStore(View(), REQUEST)
    controls = MapControls(Mock(), store, "")
    controls.rule.value = OWN
    assert store.view.limits == "auto"  # nothing is seen whose limits could be taken over
    store.dispatch(MapDrawn(DrawnMapSettings((0.1, 0.7), False, None)))
    assert controls.rule.value == "auto"
    controls.rule.value = OWN
    assert store.view.limits == (0.1, 0.7)
    controls.log.value = [LOG]
    assert (store.view.limits, store.view.log) == ((0.1, 0.7), True)  # they stay
    controls.high.value = 0.9
    assert store.view.limits == (0.1, 0.9)
    controls.low.value = 1.0
    assert "must be below" in controls.wrong.html
    assert store.view.limits == (0.1, 0.9)


def test_lines_of_motions_are_visible_in_the_dark() -> None:
    paper = RGB.from_hex_string(INK["dark"][1]).luminance
    for shade in (*REGION_COLOURS, "#000080", "#1b7050", "#ffffff"):
        drawn = RGB.from_hex_string(line_colour(shade, "dark")).luminance
        assert (drawn + 0.05) / (paper + 0.05) >= LEAST_CONTRAST
        assert line_colour(shade, "light") == shade
    assert line_colour("#ffffff", "dark") == "#ffffff"
