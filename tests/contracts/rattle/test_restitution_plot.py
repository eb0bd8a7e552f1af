"""Pictures of the plane at several restitutions: what they show is what the library says of the cells."""

import numpy as np

import rattle
from rattle.attractors.samples import Outcome
from rattle.inelastic import NAMES
from rattle.plot import codimension_two_figure, draw_restitution_figure, restitution_plane
from rattle.plot.restitution import CHAOTIC, CONTACT, P_110, QUIET_ALONE, SHOWN


def test_what_planes_show() -> None:
    delta, epsilon = np.array([0.5, 0.75]), np.array([0.03, 0.12, 0.26])
    planes = [restitution_plane(r, delta, epsilon, count=16) for r in (1.0, 0.8)]
    for plane in planes:
        for i, e in enumerate(epsilon):
            for j, d in enumerate(delta):
                found = rattle.Gear(d, e, restitution=plane.restitution).attractors(16)
                shares = {kind: sum(x.fraction for x in found if x.kind == kind) for kind in ("quiet", "chaotic")}
                assert plane.fraction_of(Outcome.QUIET)[i, j] == shares["quiet"]
                assert plane.fraction_of(Outcome.CHAOTIC)[i, j] == shares["chaotic"]
                assert plane.contact_fraction[i, j] == sum(x.fraction for x in found if x.contacts)
                assert np.isnan(plane.exponent[i, j]) == (shares["chaotic"] == 0)
    elastic, lossy = planes
    assert elastic.dominant_types[0, 1] == QUIET_ALONE
    assert lossy.dominant_types[1, 0] == P_110
    assert elastic.dominant_types[2, 0] == CHAOTIC
    assert lossy.dominant_types[2, 0] == CONTACT
    drawn = draw_restitution_figure(planes).figure
    titles = [axes.get_title() for axes in drawn.axes]
    assert titles[:2] == ["r = 1", "r = 0.8"]
    lines = {line.get_label() for line in drawn.axes[1].lines}
    assert {"SN1", "SN2", "PD1", "quiet limit"} <= lines <= {name.replace("_", " ") for name in NAMES}
    assert {text.get_text() for text in drawn.legends[0].texts} <= {*SHOWN}


def test_the_picture_of_points_has_all_of_them() -> None:
    places, wedge = codimension_two_figure().figure.axes
    assert {"COD20", "COD21", "COD22", "COD23"} <= {line.get_label() for line in places.lines}
    assert [text.get_text() for text in places.texts] == [f"r = {r:g}" for r in (1, 0.95, 0.9, 0.8, 0.6, 0.4, 0.2)]
    for line in wedge.lines:
        restitution, width = line.get_data()
        assert np.all(np.diff(width[np.argsort(restitution)]) < 0)  # the wedge widens as impacts lose more
