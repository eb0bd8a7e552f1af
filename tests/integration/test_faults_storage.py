"""Full disks, read-only stores, and damaged or lost chunks cause neither wrong nor lost results."""

import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from depth import deep
from faults import REQUEST, Faults
from service_processes import assert_bit_identical, client_of, finish, free_port, server
from typer.testing import CliRunner, Result
from waiting import wait_until
from written import compute_and_write_tile

from gear_rattle.service.cli import app
from gear_rattle.service.errors import ResponseError
from gear_rattle.workers import SurveyError, create_store, examine, finish_store, tiles_done
from gear_rattle.workers.survey.tiles import tiles_of

OPTIONS = ["--delta", "0.58:0.78:8", "--epsilon", "0.05:0.24:8", "--count", "4", "--tile", "2x2"]
N_TILES = REQUEST.n_tiles
MIDDLE = 5  # tiles that are done while the others are held
SMALL, LARGE = "size=1500k", "size=64m"  # SMALL has room for the template and some tiles


def mount(disk: Path, options: str) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", disk], check=True, capture_output=True)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """Mount a file system that is too small for the survey."""
    path = tmp_path / "disk"
    path.mkdir()
    if os.geteuid() != 0:
        pytest.skip("NOT TESTED: a full disk and a read-only store, because only root mounts a tmpfs")
    try:
        mount(path, SMALL)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f"NOT TESTED: a full disk and a read-only store, because no tmpfs can be mounted: {error}")
    yield path
    subprocess.run(["umount", "--lazy", path], check=True)


def test_a_run_on_a_full_disk_is_resumed(disk: Path, tmp_path: Path, expected: dict[str, np.ndarray]) -> None:
    faults, out = Faults(tmp_path), disk / "survey.zarr"
    command = ["run", *OPTIONS, "--out", str(out)]
    full = finish(*command, settings=faults.environment)
    assert full.returncode == 2, full.stderr
    assert "No space left on device" in full.stderr
    assert "free space" in full.stderr
    assert "Traceback" not in full.stderr
    done = len(tiles_done(REQUEST, out))
    assert 0 < done < N_TILES
    before = faults.executions().total()
    assert before <= done + 2  # it does not go on computing what cannot be written

    mount(disk, f"remount,ro,{LARGE}")
    read_only = finish(*command, settings=faults.environment)
    assert read_only.returncode == 2
    assert "Read-only file system" in read_only.stderr
    assert "Traceback" not in read_only.stderr
    assert faults.executions().total() == before

    mount(disk, f"remount,rw,{LARGE}")
    assert finish(*command, settings=faults.environment).returncode == 0
    assert_bit_identical(xr.open_zarr(out), expected)
    assert faults.executions().total() == before + N_TILES - done
    assert not list(out.rglob("*.partial"))


def test_a_service_waits_for_a_full_disk(disk: Path, tmp_path: Path, expected: dict[str, np.ndarray]) -> None:
    faults, port, data = Faults(tmp_path), free_port(), tmp_path / "data"
    faults.inject("""
        @patch("gear_rattle.workers.cluster.runner")
        def tries(runner):
            before(runner, "run_tiles", lambda *_: note("try"))
    """)
    data.mkdir()
    (data / "surveys").symlink_to(disk)
    with (
        server(data, port, "--workers", "1", settings=faults.environment),
        client_of(port) as client,
    ):
        job = client.submit(REQUEST)
        for options, words in (("", "No space left on device"), (f"remount,ro,{LARGE}", "Read-only file system")):
            if options:
                wait_until(lambda options=options: remounted(disk, options))
            wait_until(lambda words=words: words in client.call("GET", "/v1/health").json()["storage"])
            assert client.call("GET", "/v1/health").json()["status"] == "degraded"
            assert job.refresh().state == "running"
            assert "waits for its store" in job.document["message"]
        mount(disk, f"remount,rw,{LARGE}")
        job.wait()
        assert job.document["message"] == ""
        wait_until(lambda: client.call("GET", "/v1/health").json()["status"] == "ok")
        assert_bit_identical(job.open(), expected)
    assert set(faults.executions()) == set(range(N_TILES))
    # Each try ends at once when a tile cannot be written.
    assert faults.executions().total() <= N_TILES + 2 * faults.notes("try").total()


@deep
def test_a_service_waits_for_its_data_directory(tmp_path: Path, expected: dict[str, np.ndarray]) -> None:
    """While the disk is unmounted, the survey waits; nothing is written into the directory in its place."""
    faults, port, data, away = Faults(tmp_path), free_port(), tmp_path / "data", tmp_path / "away"
    faults.hold(MIDDLE)
    with (
        server(data, port, "--workers", "1", settings=faults.environment),
        client_of(port) as client,
    ):
        job = client.submit(REQUEST)
        wait_until(lambda: faults.executions()[MIDDLE] and job.refresh().document["tiles_done"] == MIDDLE)
        data.rename(away)
        data.mkdir()
        faults.release()
        wait_until(lambda: client.call("GET", "/v1/health").json()["storage"] != "ok")
        assert client.call("GET", "/v1/health").json()["status"] == "degraded"
        with pytest.raises(ResponseError, match="data directory") as refused:
            client.submit(REQUEST, force=True)
        assert refused.value.status == 503
        data.rmdir()  # nothing was written there
        away.rename(data)
        job.wait()
        wait_until(lambda: client.call("GET", "/v1/health").json()["status"] == "ok")
        assert_bit_identical(job.open(), expected)
    assert set(faults.executions()) == set(range(N_TILES))
    assert faults.executions().total() <= N_TILES + 1  # the running tile may be repeated


def remounted(disk: Path, options: str) -> bool:
    """Return whether the disk could be remounted; while a file is open for writing, it cannot."""
    try:
        mount(disk, options)
    except subprocess.CalledProcessError:
        return False
    return True


@pytest.fixture
def store(tmp_path: Path) -> Path:
    path = tmp_path / "survey.zarr"
    create_store(REQUEST, path)
    for tile in tiles_of(REQUEST):
        compute_and_write_tile(REQUEST, str(path), tile)
    finish_store(path)
    return path


def verify(path: Path) -> Result:
    """Run `rattle verify` in this process."""
    return CliRunner().invoke(app, ["verify", str(path)])


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def test_damaged_and_lost_chunks_are_found_and_computed_again(
    store: Path, tmp_path: Path, expected: dict[str, np.ndarray]
) -> None:
    assert verify(store).exit_code == 0
    flip(store / "attractor_phase" / "c" / "0" / "2" / "3")
    (store / "lyapunov_max" / "c" / "3" / "3").write_bytes(b"")
    lost = "orbit_exists"
    blank = next(tile for tile in tiles_of(REQUEST) if not expected[lost][:, tile.epsilon, tile.delta].any())
    row, column = divmod(blank.index, 4)
    (store / lost / "c" / "0" / str(row) / str(column)).unlink()  # a chunk of fill values only has a file, too
    flip(store / "status" / "c" / "1" / "1")
    flip(store / "delta" / "c" / "0")
    (store / "curves" / "G1" / "zarr.json").write_text("{}")
    root = json.loads((store / "zarr.json").read_bytes())
    root["consolidated_metadata"]["metadata"]["quiet_fraction"] |= {"data_type": "int64", "fill_value": 0}
    (store / "zarr.json").write_text(json.dumps(root))
    damage = {11: ("attractor_phase",), 15: ("lyapunov_max",), blank.index: (lost,), 5: ("status",)}
    found = examine(store)
    assert found.damaged == damage
    assert set(found.template) == {"zarr.json", "delta/c/0", "curves/G1/zarr.json"}
    assert found.done == set(range(N_TILES)) - set(damage)
    with pytest.raises(ValueError, match="checksum"):  # plain xarray raises as well
        _ = xr.open_zarr(store)["attractor_phase"].values

    told = finish("verify", str(store))
    assert told.returncode == 1
    assert "12 whole, 4 damaged" in told.stdout
    assert "tile 11: attractor_phase" in told.stdout
    assert "damaged: delta/c/0" in told.stdout
    assert "damaged: zarr.json" in told.stdout

    faults = Faults(tmp_path)
    again = finish("run", *OPTIONS, "--out", str(store), settings=faults.environment)
    assert again.returncode == 0, again.stderr
    assert faults.executions() == dict.fromkeys(damage, 1)
    assert verify(store).exit_code == 0
    assert_bit_identical(xr.open_zarr(store), expected)
    assert np.array_equal(xr.open_zarr(store)["delta"], REQUEST.delta.values())
    assert examine(store).is_whole


def test_every_byte_of_a_chunk_is_under_its_checksum(store: Path) -> None:
    for name in ("status", "attractor_fraction", "orbit_exists", "quiet_fraction"):
        array = zarr.open_array(store / name, mode="r")
        chunk = store / name / array.metadata.encode_chunk_key((0,) * (array.ndim - 2) + (2, 3))
        content = chunk.read_bytes()
        assert len(content) > 12
        for position in range(len(content)):
            chunk.write_bytes(content[:position] + bytes([content[position] ^ 4]) + content[position + 1 :])
            with pytest.raises(ValueError, match="checksum"):
                _ = array[..., 4:6, 6:8]
        chunk.write_bytes(content)
        _ = array[..., 4:6, 6:8]


def test_what_is_not_a_survey_cannot_be_verified(tmp_path: Path) -> None:
    with pytest.raises(SurveyError, match="is empty"):
        examine(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(SurveyError, match="holds no store that can be read"):
        examine(tmp_path)
    told = finish("verify", str(tmp_path / "missing"))
    assert told.returncode == 2
    assert "does not exist" in told.stderr
    assert "Traceback" not in told.stderr
