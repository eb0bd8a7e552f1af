"""`rattle copy` writes the same bytes elsewhere, completely or not at all, and copies nothing that is damaged."""

from pathlib import Path

import icechunk
import numpy as np
import pytest
import xarray as xr
import zarr
from s3_server import BUCKET, S3
from typer.testing import CliRunner

import gear_rattle.workers.storage.copy
from gear_rattle.service.cli import app
from gear_rattle.workers import Axis, StorageError, StoreInBucket, SurveyError, examine, open_survey, run_survey
from gear_rattle.workers.storage.copy import copy_store
from gear_rattle.workers.survey.manifest import ROOT

SURVEY = {
    "delta": Axis(start=0.5, stop=0.9, num=5),
    "epsilon": Axis(start=0.05, stop=0.2, num=7),
    "quantities": ("region", "orbits", "grazing"),
    "tile": {"delta": 3, "epsilon": 4},
}


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("survey") / "survey.zarr"
    run_survey(out=path, **SURVEY).close()  # type: ignore[arg-type]
    return path


@pytest.fixture
def s3(storage: S3, monkeypatch: pytest.MonkeyPatch) -> S3:
    for name, value in storage.settings.items():
        monkeypatch.setenv(name, value)
    return storage


def files_in(path: Path) -> dict[str, bytes]:
    found = {each.relative_to(path).as_posix(): each.read_bytes() for each in path.rglob("*") if each.is_file()}
    return {key: content for key, content in found.items() if key != ".lock"}


def command(*arguments: str | Path) -> str:
    done = CliRunner().invoke(app, ["copy", *map(str, arguments)])
    assert done.exit_code == 0, done.exception or done.output
    return done.stdout


@pytest.mark.usefixtures("s3")
def test_through_a_bucket_and_a_zip_file_and_back(survey: Path, tmp_path: Path) -> None:
    before, url = files_in(survey), f"s3://{BUCKET}/copies/{tmp_path.name}.zarr"
    size = sum(map(len, before.values()))
    said = command(survey, url)
    assert f"{len(before):,} files, {size:,} bytes, all checksums agree." in said
    bucket = StoreInBucket(url)
    copied = list(bucket.keys())
    assert dict(zip(copied, map(bucket.read, copied), strict=True)) == before
    command(url, tmp_path / "survey.zip")
    command(tmp_path / "survey.zip", tmp_path / "back.zarr")
    assert files_in(tmp_path / "back.zarr") == before
    assert examine(tmp_path / "back.zarr") == examine(url) == examine(survey)


def test_a_zip_file_is_opened_by_xarray_and_by_this_package(survey: Path, tmp_path: Path) -> None:
    file = tmp_path / "survey.zip"
    command(survey, file)
    with (
        open_survey(survey) as whole,
        open_survey(file) as found,
        xr.open_zarr(zarr.storage.ZipStore(file, mode="r")) as plain,
    ):
        xr.testing.assert_identical(found, whole)
        assert np.array_equal(plain["region"], whole["region"])


def test_a_copy_as_an_icechunk_repository_is_one_commit_with_every_array(survey: Path, tmp_path: Path) -> None:
    target = tmp_path / "survey.icechunk"
    said = command(survey, target)
    repository = icechunk.Repository.open(icechunk.local_filesystem_storage(str(target)))
    assert len(list(repository.ancestry(branch="main"))) == 2  # the empty snapshot and the copy
    session = repository.readonly_session("main")
    own = zarr.open_group(survey, mode="r")
    copied = zarr.open_group(session.store, mode="r", use_consolidated=False)
    arrays = {name: each for name, each in own.members(max_depth=None) if isinstance(each, zarr.Array)}
    assert len(arrays) > 20
    for name, each in arrays.items():
        assert (copied[name].chunks, copied[name].attrs.asdict()) == (each.chunks, each.attrs.asdict())
        np.testing.assert_array_equal(copied[name], each)
    assert f"{len(files_in(survey)) - 1:,} files" in said  # all but the manifest
    with (
        xr.open_zarr(survey) as stored,
        xr.open_zarr(session.store, consolidated=False) as found,
    ):
        xr.testing.assert_identical(found.load(), stored.load())
    with pytest.raises(SurveyError, match="has a commit already"):
        copy_store(survey, target)
    (tmp_path / "other.icechunk").mkdir()
    with pytest.raises(SurveyError, match="choose another directory"):
        copy_store(survey, tmp_path / "other.icechunk")


def test_an_interrupted_icechunk_copy_has_no_commit_and_is_begun_again(
    survey: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, copying = tmp_path / "copy.icechunk", gear_rattle.workers.storage.copy
    monkeypatch.setattr(copying, "BATCH", 20)
    with pytest.raises(KeyboardInterrupt):
        copy_store(survey, target, lambda done, _: (_ for _ in ()).throw(KeyboardInterrupt) if done > 30 else None)
    repository = icechunk.Repository.open(icechunk.local_filesystem_storage(str(target)))
    assert len(list(repository.ancestry(branch="main"))) == 1
    assert copy_store(survey, target).files == len(files_in(survey)) - 1
    assert len(list(repository.ancestry(branch="main"))) == 2


def test_a_copy_as_netcdf_holds_the_numbers_and_checksums(survey: Path, tmp_path: Path) -> None:
    file = tmp_path / "survey.nc"
    command(survey, file)
    with open_survey(survey, as_stored=True) as whole, xr.open_dataset(file, engine="h5netcdf") as found:
        for name, values in whole.data_vars.items():
            assert np.array_equal(found[name], values, equal_nan=values.dtype.kind == "f"), name
            assert found[name].encoding["fletcher32"] is bool(values.ndim and values.dtype.kind in "biuf"), name


def test_an_interrupted_copy_is_no_store_and_is_continued(
    survey: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, read, count = (
        tmp_path / "copy.zarr",
        gear_rattle.workers.storage.copy._read_with_known_digest,
        iter(range(10**6)),
    )

    def dying(*given: object) -> bytes:
        if next(count) == 20:
            raise StorageError("the power is gone")
        return read(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(gear_rattle.workers.storage.copy, "_read_with_known_digest", dying)
    with pytest.raises(StorageError, match="the power is gone"):
        copy_store(survey, target)
    with pytest.raises(SurveyError):
        open_survey(target)
    assert not (target / ROOT).exists()
    monkeypatch.undo()
    assert copy_store(survey, target).kept >= 10
    assert files_in(target) == files_in(survey)
    assert copy_store(survey, target).kept == len(files_in(survey)) - 1  # all but the manifest


def test_what_is_damaged_is_not_copied(survey: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.zarr"
    copy_store(survey, damaged)
    (chunk,) = damaged.glob("region/c/0/0")
    chunk.write_bytes(chunk.read_bytes()[:-1] + b"!")
    for target in (tmp_path / "copy.zarr", tmp_path / "copy.zip"):
        with pytest.raises(SurveyError, match=r"region/c/0/0 of .* is damaged"):
            copy_store(damaged, target)
        assert not (target / ROOT).exists()
        assert not target.is_file()
    chunk.unlink()
    with pytest.raises(SurveyError, match="is lost"):
        copy_store(damaged, tmp_path / "copy.zip")


def test_nothing_is_written_over(survey: Path, tmp_path: Path) -> None:
    other, foreign, file = tmp_path / "other.zarr", tmp_path / "foreign", tmp_path / "file.zip"
    run_survey(out=other, **SURVEY | {"seed": 1}).close()  # type: ignore[arg-type]
    foreign.mkdir()
    (foreign / "mine").touch()
    file.touch()
    for target, said in ((other, "another survey"), (foreign, "not a copy"), (file, "exists")):
        with pytest.raises(SurveyError, match=said):
            copy_store(survey, target)
    assert list(foreign.iterdir()) == [foreign / "mine"]
    assert CliRunner().invoke(app, ["copy", "http://127.0.0.1/v1", str(tmp_path / "x")]).exit_code == 2
