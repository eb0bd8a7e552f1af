"""A slice of a survey with a third axis, chosen by a slider in a browser."""

from urllib.parse import urljoin

import httpx
import numpy as np
import xarray as xr
from depth import deep
from explorer_support import SURVEY, of_map, open_view
from playwright.sync_api import Page, expect
from service_processes import get
from waiting import HANG, wait_until

BODY = SURVEY | {"beta": {"start": 0.4, "stop": 0.8, "num": 3}, "quantities": ["region"]}


def shown(page: Page) -> np.ndarray:
    """The regions that are drawn."""
    images = of_map(
        page,
        "renderers.filter((each) => each.name?.startsWith('cells') && each.data_source.data.image.length)"
        ".map((each) => Array.from(each.data_source.data.image[0]))",
    )
    return np.array(images[0])


@deep
def test_a_slider_chooses_the_slice(page: Page, service: str) -> None:
    here = httpx.post(f"{service}/v1/surveys", json=BODY, timeout=HANG).json()["links"]["self"]
    wait_until(lambda: get(service + here).json()["state"] == "successful")
    survey_id = here.rpartition("/")[2]
    open_view(page, service, survey=survey_id, slice="1")
    expect(page.get_by_text("β = 0.6:")).to_be_visible()
    with xr.open_zarr(f"{service}{here}/store") as survey:
        regions = survey.region.values.astype(float)
    assert (regions[1] != regions[2]).any()
    wait_until(lambda: shown(page).size == regions[1].size and (shown(page) == regions[1].ravel()).all())
    expect(page.locator(".detail pre")).to_contain_text("survey.region.isel(beta=1).plot()")
    slider = page.get_by_role("slider")
    slider.focus()
    slider.press("ArrowRight")
    expect(page.get_by_text("β = 0.8:")).to_be_visible()
    wait_until(lambda: (shown(page) == regions[2].ravel()).all())
    wait_until(lambda: "slice=2" in page.url)
    link = page.get_by_role("link", name="PNG").get_attribute("href")
    assert link is not None
    assert f"{survey_id}/map.png?variable=region&slice=2&" in link
    picture = httpx.get(urljoin(page.url, link), timeout=HANG)
    assert picture.headers["content-type"] == "image/png"
    httpx.delete(service + here, timeout=HANG)
