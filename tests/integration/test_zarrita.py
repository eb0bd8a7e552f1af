"""zarrita, a JavaScript library, reads every array of a survey over HTTP in node (`make readers` installs it)."""

import functools
import json
import shutil
import subprocess
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from depth import deep
from waiting import HANG

from gear_rattle.workers import Group, run_survey
from gear_rattle.workers.survey.levels import grid

READERS = Path(__file__).parents[1] / "readers"
INSTALLED = shutil.which("node") is not None and (READERS / "node_modules" / "zarrita").is_dir()


class Silent(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.mark.skipif(not INSTALLED, reason="node or zarrita is not there: make readers")
@pytest.mark.parametrize(
    "beta", [pytest.param(0.6, marks=deep, id="a plane"), pytest.param((0.6, 0.7, 2), id="a third axis with levels")]
)
def test_zarrita_reads_every_array(
    tmp_path: Path, beta: float | tuple[float, float, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grid, "LARGEST_WITHOUT_LEVELS", 3 if beta == 0.6 else 2)
    monkeypatch.setattr(grid, "LARGEST_NOT_HALVED", 2)
    run_survey(
        delta=(0.55, 0.7, 3),
        epsilon=(0.05, 0.1, 2),
        initial_conditions={"count": 4},
        quantities=tuple(set(Group) - {Group.BASINS}),
        beta=beta,
        out=tmp_path / "survey.zarr",
    ).close()
    with ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Silent, directory=str(tmp_path))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/survey.zarr"
        said = subprocess.run(
            ["node", "read.mjs", url], cwd=READERS, capture_output=True, text=True, timeout=HANG, check=False
        )
        server.shutdown()
    assert said.returncode == 0, said.stderr
    read = {each["path"].strip("/"): each for each in map(json.loads, said.stdout.splitlines())}
    with xr.open_datatree(tmp_path / "survey.zarr", engine="zarr") as tree:
        ours = {
            f"{node.path}/{name}".strip("/"): array.values
            for node in tree.subtree
            for name, array in node.to_dataset(inherit=False).variables.items()
        }
    assert {name for name, values in ours.items() if values.size} - read.keys() == set()
    assert len(ours) > 100
    assert ("levels/1/region_occurs" in ours) is (beta != 0.6)
    for name, values in ours.items():
        if values.dtype.kind in "OUT":
            assert not values.size or read[name]["texts"] == values.ravel().tolist(), name
        elif values.size:
            numbers = values.astype(float)
            assert read[name]["nan"] == np.isnan(numbers).sum(), name
            assert read[name]["sum"] == pytest.approx(numbers[np.isfinite(numbers)].sum(), rel=1e-9), name
