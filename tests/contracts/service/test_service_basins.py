"""GET /v1/basins.png: what it shows is what the library computes."""

from collections.abc import Iterator
from io import BytesIO

import numpy as np
import pytest
from fastapi.testclient import TestClient
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from service_support import IN_A_THREAD, assert_problem, front_end

import rattle
from rattle.plot.colours import colour
from rattle.stiff import StiffGear


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(
        tmp_path_factory.mktemp("data"), points=IN_A_THREAD, max_basin_resolution=60, max_point_count=4
    ) as client:
        yield client


@pytest.mark.parametrize(("epsilon", "beta"), [(0.1, 0.6), (0.12, 0.4)])
def test_the_picture_has_the_basins_in_their_colours(client: TestClient, epsilon: float, beta: float) -> None:
    answer = client.get(f"/v1/basins.png?delta=0.6&epsilon={epsilon}&beta={beta}&resolution=60")
    assert answer.headers["content-type"] == "image/png"
    pixels = imread(BytesIO(answer.content))[..., :3]
    basins = rattle.Gear(0.6, epsilon, beta).basins(60, 7.0, "direct")
    shades = [np.all(np.abs(pixels - to_rgb(colour(each))) < 3 / 255, axis=-1) for each in basins.attractors]
    total = sum(int(shade.sum()) for shade in shades)
    assert total > 0.4 * pixels[..., 0].size  # the panel fills the picture, but for its legend
    for i, shade in enumerate(shades):
        assert shade.sum() / total == pytest.approx((basins.labels == i).mean(), abs=0.02)


def test_a_part_of_the_plane_of_states(client: TestClient) -> None:
    box = "tau_min=0.6&tau_max=0.9&v_min=2.5&v_max=5"
    answer = client.get(f"/v1/basins.png?delta=0.6&epsilon=0.1&resolution=60&{box}")
    pixels = imread(BytesIO(answer.content))[..., :3]
    basins = rattle.Gear(0.6, 0.1).basins(60, method="direct", tau=(0.6, 0.9), v=(2.5, 5.0))
    shades = [np.all(np.abs(pixels - to_rgb(colour(each))) < 3 / 255, axis=-1) for each in basins.attractors]
    total = sum(int(shade.sum()) for shade in shades)
    assert total > 0.4 * pixels[..., 0].size
    for i, shade in enumerate(shades):
        assert shade.sum() / total == pytest.approx((basins.labels == i).mean(), abs=0.02)


@pytest.mark.parametrize(
    ("box", "field"),
    [
        ("tau_min=0.5&tau_max=0.4", "query.tau_min"),
        ("tau_max=1.5", "query.tau_max"),
        ("v_min=8", "query.v_min"),
        ("v_max=inf", "query.v_max"),
    ],
)
def test_boxes_that_are_refused(client: TestClient, box: str, field: str) -> None:
    assert_problem(client.get(f"/v1/basins.png?delta=0.6&epsilon=0.1&resolution=9&{box}"), 422, field)


@pytest.mark.parametrize("stiffness", ["", "&kappa=1e4"])
def test_states_go_where_the_library_says(client: TestClient, stiffness: str) -> None:
    states = "tau=0.2&tau=0.79&tau=0.5&v=0.1&v=3.77&v=6.5"
    found = client.get(f"/v1/reached?delta=0.6&epsilon=0.0615&{states}{stiffness}").json()
    gear = StiffGear(0.6, 0.0615, 0.6, 1e4) if stiffness else rattle.Gear(0.6, 0.0615)
    own = gear.reached([0.2, 0.79, 0.5], [0.1, 3.77, 6.5])
    assert found["which"] == own.which.tolist()
    assert found["impacts"] == own.impacts.tolist()
    assert [each["kind"] for each in found["attractors"]] == [each.kind for each in own.attractors]
    assert [each["fraction"] for each in found["attractors"]] == [each.fraction for each in own.attractors]


@pytest.mark.parametrize(
    ("states", "field"),
    [
        ("tau=0.2", "query.v"),
        ("tau=0.2&v=0", "query.v"),
        ("tau=nan&v=1", "query.tau"),
        ("tau=0.2&tau=0.3&tau=0.4&v=1&v=2", "shapes of tau and v do not broadcast"),
        ("tau=0.2&tau=0.3&tau=0.4&tau=0.5&tau=0.6&v=1", "at most 4 states"),
    ],
)
def test_states_that_are_refused(client: TestClient, states: str, field: str) -> None:
    assert_problem(client.get(f"/v1/reached?delta=0.6&epsilon=0.0615&{states}"), 422, field)


@pytest.mark.parametrize("resolution", ["0", "x", "61", "1e3"])
def test_resolutions_that_are_refused(client: TestClient, resolution: str) -> None:
    answer = client.get(f"/v1/basins.png?delta=0.6&epsilon=0.1&resolution={resolution}")
    assert_problem(answer, 422, "query.resolution")
