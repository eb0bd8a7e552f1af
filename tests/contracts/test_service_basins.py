"""GET /v1/basins.png: what it shows is what the library computes."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.image import imread
from service_support import assert_problem, front_end

import rattle
from rattle.plot.colours import colour


@pytest.mark.parametrize(("epsilon", "beta"), [(0.1, 0.6), (0.12, 0.4)])
def test_the_picture_has_the_basins_in_their_colours(tmp_path: Path, epsilon: float, beta: float) -> None:
    with front_end(tmp_path) as client:
        answer = client.get(f"/v1/basins.png?delta=0.6&epsilon={epsilon}&beta={beta}&resolution=60")
    assert answer.headers["content-type"] == "image/png"
    pixels = imread(BytesIO(answer.content))[..., :3]
    basins = rattle.Gear(0.6, epsilon, beta).basins(60, 7.0, "direct")
    shades = [np.all(np.abs(pixels - to_rgb(colour(each))) < 3 / 255, axis=-1) for each in basins.attractors]
    total = sum(int(shade.sum()) for shade in shades)
    assert total > 0.4 * pixels[..., 0].size  # the panel fills the picture, but for its legend
    for i, shade in enumerate(shades):
        assert shade.sum() / total == pytest.approx((basins.labels == i).mean(), abs=0.02)


@pytest.mark.parametrize("resolution", ["0", "x", "41", "1e3"])
def test_resolutions_that_are_refused(tmp_path: Path, resolution: str) -> None:
    with front_end(tmp_path, max_basin_resolution=40) as client:
        answer = client.get(f"/v1/basins.png?delta=0.6&epsilon=0.1&resolution={resolution}")
        assert_problem(answer, 422, "query.resolution")
