"""GET /v1/basins.png: what it shows is what the library computes."""

from collections.abc import Iterator
from io import BytesIO

import numpy as np
import pytest
from fastapi.testclient import TestClient
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from service_support import assert_problem, front_end

import rattle
from rattle.plot.colours import colour


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    with front_end(tmp_path_factory.mktemp("data"), max_basin_resolution=60) as client:
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


@pytest.mark.parametrize("resolution", ["0", "x", "61", "1e3"])
def test_resolutions_that_are_refused(client: TestClient, resolution: str) -> None:
    answer = client.get(f"/v1/basins.png?delta=0.6&epsilon=0.1&resolution={resolution}")
    assert_problem(answer, 422, "query.resolution")
