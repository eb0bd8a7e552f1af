"""A survey with more cells than a browser has pixels: made, levels and all, and drawn by a real service."""

import httpx
import numpy as np
import xarray as xr
from depth import deep
from explorer_support import SURVEY, of_map, open_view, wait_for_map
from playwright.sync_api import Page
from service_processes import get
from waiting import HANG, wait_until

LARGE = SURVEY | {"name": "large", "quantities": ["region"], "delta": {"start": 0.4, "stop": 1.0, "num": 1030}}
IMAGE = "renderers.find((each) => each.name === 'cells0').data_source.data.image[0]"


@deep
def test_no_pixel_has_two_cells(page: Page, service: str) -> None:
    here = httpx.post(f"{service}/v1/surveys", json=LARGE, timeout=HANG).json()
    wait_until(lambda: get(service + here["links"]["self"]).json()["state"] == "successful")
    store = f"{service}/v1/surveys/{here['id']}/store"
    for level, cells in (("levels/1", 2), ("levels/2", 4)):
        with xr.open_zarr(store, group=level) as one, xr.open_zarr(store) as survey:
            region = survey.region.values
            occurs = [
                np.bitwise_or.reduce(1 << region[:, i : i + cells].astype(np.uint32), axis=1)
                for i in range(0, 1030, cells)
            ]
            np.testing.assert_array_equal(one.region_occurs.values, np.stack(occurs, axis=1))
    page.set_viewport_size({"width": 1100, "height": 700})
    open_view(page, service, survey=here["id"])
    wait_for_map(page, f"{IMAGE}?.shape?.[1] <= map.inner_width")
    assert of_map(page, f"{IMAGE}.shape") in ([29, 515], [29, 258])
