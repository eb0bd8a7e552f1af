"""Exported files keep the CF conventions, according to the public compliance checker."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from depth import either
from waiting import HANG

from gear_rattle import split_complex
from gear_rattle.workers import Group, SurveyRequest, create_store, open_survey, run_survey
from gear_rattle.workers.storage.export import write_netcdf
from gear_rattle.workers.storage.store import open_groups

CHECKER = Path(__file__).parents[2] / ".venv-cf" / "bin" / "compliance-checker"
AXES: dict[str, Any] = {"delta": (0.55, 0.7, 2), "epsilon": (0.05, 0.1, 2), "initial_conditions": {"count": 4}}
PRIORITIES = ("high_priorities", "medium_priorities", "low_priorities")


def file_of(store: Path, out: Path) -> Path:
    with open_survey(store, as_stored=True) as survey, write_netcdf(survey, open_groups(store)) as file:
        out.write_bytes(file.read())
    return out


def complaints(*files: Path) -> list[list[str]]:
    """Return the complaints of the compliance checker about each file."""
    out = files[0].with_name("report.json")
    checks = ["--test=cf:1.11", "--criteria=strict", "--format=json_new", f"--output={out}"]
    done = subprocess.run(
        [CHECKER, *checks, *files], capture_output=True, text=True, timeout=HANG, check=False
    )  # its exit status is not checked: it is nonzero if there are complaints
    assert out.exists(), done.stderr
    found = json.loads(out.read_text())
    return [
        [text for priority in PRIORITIES for each in found[str(file)]["cf:1.11"][priority] for text in each["msgs"]]
        for file in files
    ]


def plain(tmp_path: Path) -> Path:
    create_store(SurveyRequest(**AXES, quantities=tuple(set(Group) - {Group.FAMILIES})), tmp_path / "plain.zarr")
    return tmp_path / "plain.zarr"


def stiff(tmp_path: Path) -> Path:
    create_store(SurveyRequest(**AXES, model="stiff", kappa=1e4), tmp_path / "stiff.zarr")
    return tmp_path / "stiff.zarr"


def third(tmp_path: Path) -> Path:
    joined = ("region", "orbits", "families")
    run_survey(**AXES, beta=(0.6, 0.7, 2), quantities=joined, out=tmp_path / "third.zarr").close()
    return tmp_path / "third.zarr"


def by_their_owners(store: Path) -> list[Path]:
    """Write files as users do, with `to_netcdf` of an open survey: in its own chunks, and a part in other chunks."""
    files = [store.with_name(f"{store.stem}-{how}.nc") for how in ("stored", "split")]
    with open_survey(store, as_stored=True) as survey:
        survey.to_netcdf(files[0], engine="h5netcdf")
    with open_survey(store) as survey:
        split_complex(survey.isel(delta=slice(0, 2)).chunk({"epsilon": 1})).to_netcdf(files[1], engine="h5netcdf")
    return files


def test_the_checker_of_cf_finds_nothing(tmp_path: Path) -> None:
    stores = [make(tmp_path) for make in either((third,), (plain, stiff, third))]
    files = [file_of(store, store.with_suffix(".nc")) for store in stores]
    files += [file for store in stores for file in by_their_owners(store)]
    with xr.open_dataset(files[0], engine="h5netcdf") as survey:
        wrong = survey[["region"]].load()
        wrong["region"].attrs["flag_values"] = np.array([0.0, 1.0])  # wrong type, and too few values
        wrong.to_netcdf(tmp_path / "wrong.nc", engine="h5netcdf")
    *found, of_wrong = complaints(*files, tmp_path / "wrong.nc")
    assert found == [[]] * len(files)
    assert any("flag_values" in text for text in of_wrong)
