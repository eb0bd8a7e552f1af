"""Stores in a bucket have the same bytes as on disk, appear complete or not at all, and have one writer."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import zarr
from depth import deep
from s3_server import BUCKET, S3
from written import write_tile

import gear_rattle.workers.storage.bucket
from gear_rattle.workers import (
    Axis,
    StorageError,
    StoreInBucket,
    SurveyError,
    SurveyRequest,
    Tile,
    compute_tile,
    create_store,
    examine,
    finish_store,
    join_attractors_of_survey,
    open_survey,
    place_of,
    tiles_done,
    tiles_of,
)  # fmt: skip
from gear_rattle.workers.storage import bucket_lock

REQUEST = SurveyRequest(
    delta=Axis(start=0.5, stop=0.9, num=5),
    epsilon=Axis(start=0.05, stop=0.2, num=7),
    quantities=("region", "orbits", "grazing"),
    tile={"delta": 3, "epsilon": 4},
)
OTHER = REQUEST.model_copy(update={"seed": 1})
TILES = tiles_of(REQUEST)


@pytest.fixture
def s3(storage: S3, monkeypatch: pytest.MonkeyPatch) -> S3:
    for name, value in storage.settings.items():
        monkeypatch.setenv(name, value)
    return storage


@pytest.fixture(autouse=True)
def _few_objects(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the curves (190 of the 216 objects of a template), except in the test that checks them."""
    if request.function is not test_bytes_are_those_on_disk:
        monkeypatch.setattr("gear_rattle.workers.survey.template._write_curves", lambda *_: None)


@pytest.fixture
def url(s3: S3, request: pytest.FixtureRequest) -> str:  # noqa: ARG001
    return f"s3://{BUCKET}/{request.node.name}/survey.zarr"


def fill(where: str | Path, tiles: list[Tile]) -> None:
    for tile in tiles:
        write_tile(REQUEST, str(where), tile, compute_tile(REQUEST, tile)[0])


def documents(place: Any) -> dict[str, bytes]:
    return {key: place.read(key) for key in place.keys("")}


def test_bytes_are_those_on_disk(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gear_rattle.workers.survey.template.current_time", lambda: "2009-01-01T00:00:00+00:00")
    monkeypatch.setattr("gear_rattle.workers.storage.store.current_time", lambda: "2009-01-01T00:00:00+00:00")
    path = tmp_path / "survey.zarr"
    for where in (url, path):
        create_store(REQUEST, where)
        fill(where, TILES)
        finish_store(where)
    on_disk = {str(file.relative_to(path)): file.read_bytes() for file in path.rglob("*") if file.is_file()}
    assert on_disk.pop(".lock") == b""
    assert documents(place_of(url)) == on_disk
    assert examine(url) == examine(path)


@deep
def test_families_are_joined_in_it(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The join leaves no temporary file."""
    monkeypatch.setattr("gear_rattle.workers.families.join._read_curves", lambda *_: {})
    monkeypatch.setattr("gear_rattle.workers.families.blocks.SLOTS_OF_BLOCK", 8 * 3**2)
    groups = {"quantities": ("attractors", "lyapunov", "families"), "initial_conditions": {"count": 4}}
    request = SurveyRequest.model_validate(REQUEST.model_dump() | groups)
    create_store(request, url)
    for tile in tiles_of(request):
        write_tile(request, url, tile, compute_tile(request, tile)[0])
    join_attractors_of_survey(request, url)
    finish_store(url)
    assert examine(url).is_whole
    assert not [key for key in documents(place_of(url)) if "joining" in key]
    with open_survey(url) as survey, open_survey(url, "families") as families:
        listed = survey["attractor_family"].load()
        assert int(families["cells"].sum()) == int((listed >= 0).sum()) + families.sizes["entered"]


def test_plain_xarray_opens_it(url: str) -> None:
    create_store(REQUEST, url)
    fill(url, TILES)
    finish_store(url)
    from obstore.store import from_url

    plain = xr.open_zarr(zarr.storage.ObjectStore(from_url(url), read_only=True))
    xr.testing.assert_identical(plain.load(), open_survey(url, as_stored=True).load())
    assert np.all(plain["status"] > 0)


def test_template_cut_short_is_built_again(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import obstore

    put, count = obstore.put, iter(range(1000))

    def dying(*arguments: Any, **options: Any) -> Any:
        if next(count) == 12:
            raise KeyboardInterrupt
        return put(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(obstore, "put", dying)
        with pytest.raises(KeyboardInterrupt):
            create_store(REQUEST, url)
    place = place_of(url)
    assert not place.exists()
    assert len(list(place.keys())) == 11  # including its marker; the lock was released
    create_store(REQUEST, url)
    assert examine(url).template == ()


def test_what_is_not_a_survey_is_left_alone(url: str) -> None:
    import obstore

    place = place_of(url)
    assert isinstance(place, StoreInBucket)
    obstore.put(place.objects, "notes.txt", b"mine")
    with pytest.raises(SurveyError, match="not a survey"):
        create_store(REQUEST, url)
    assert documents(place) == {"notes.txt": b"mine"}


def test_another_survey_is_left_alone(url: str) -> None:
    create_store(REQUEST, url)
    before = documents(place_of(url))
    with pytest.raises(SurveyError, match="another survey"):
        create_store(OTHER, url)
    assert documents(place_of(url)) == before


def test_one_writer(url: str) -> None:
    create_store(REQUEST, url)
    with place_of(url).lock_for_writing():
        for second in (place_of(url).lock_for_writing().__enter__, lambda: finish_store(url)):
            with pytest.raises(SurveyError, match="another run"):
                second()
    with place_of(url).lock_for_writing():  # the lock was released
        pass


def test_the_lock_of_a_dead_process_is_taken_over(url: str) -> None:
    import obstore

    place = place_of(url)
    assert isinstance(place, StoreInBucket)
    with subprocess.Popen(["true"]) as ended:
        pass
    holder = bucket_lock.process_identity() | {"process": ended.pid}
    obstore.put(place.objects, gear_rattle.workers.storage.bucket.LOCK, json.dumps(holder).encode())
    with place.lock_for_writing():
        pass
    elsewhere = json.dumps(holder | {"host": "elsewhere"}).encode()
    obstore.put(place.objects, gear_rattle.workers.storage.bucket.LOCK, elsewhere)
    with pytest.raises(SurveyError, match=r"on elsewhere.*delete the object .*\.lock"), place.lock_for_writing():
        pass
    assert place.read(gear_rattle.workers.storage.bucket.LOCK) == elsewhere


def test_lost_and_damaged_objects_are_found_and_mended(url: str) -> None:
    import obstore

    create_store(REQUEST, url)
    fill(url, TILES)
    place = place_of(url)
    assert isinstance(place, StoreInBucket)
    before = documents(place)
    obstore.delete(place.objects, "region/c/0/0")
    damaged = bytearray(before["orbit_phase/c/0/1/0"])
    damaged[-1] ^= 1
    obstore.put(place.objects, "orbit_phase/c/0/1/0", bytes(damaged))
    obstore.put(place.objects, "delta/c/0", b"?")
    assert tiles_done(REQUEST, url) == {1, 3}
    create_store(REQUEST, url)
    fill(url, [TILES[0], TILES[2]])
    assert documents(place) == before


def test_deletion_cut_short_is_no_store(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    import obstore

    create_store(REQUEST, url)
    place = place_of(url)
    assert isinstance(place, StoreInBucket)
    with monkeypatch.context() as patch:
        patch.setattr(obstore, "list", lambda _: (_ for _ in ()).throw(KeyboardInterrupt))
        patch.setattr(place, "keys", lambda: iter(["something"]))
        with pytest.raises(KeyboardInterrupt):
            place.delete()
    assert not place.exists()
    assert place.has_deletion_begun()
    with pytest.raises(SurveyError):
        create_store(REQUEST, url)
    place.delete()
    assert documents(place) == {}
    create_store(REQUEST, url)


def test_a_server_that_fails_once_is_asked_again(url: str, s3: S3) -> None:
    create_store(REQUEST, url)
    s3.fail(2)
    fill(url, TILES)
    finish_store(url)
    assert examine(url).is_whole


def test_a_server_that_fails_is_waited_for(url: str, s3: S3, monkeypatch: pytest.MonkeyPatch) -> None:
    create_store(REQUEST, url)
    monkeypatch.setattr(gear_rattle.workers.storage.bucket, "RETRIES", 0)
    impatient = StoreInBucket(url)
    s3.fail(100)
    with pytest.raises(StorageError):
        examine(impatient)
    s3.fail(0)
    assert examine(impatient).is_whole


@pytest.mark.parametrize("where", ["s3://bucket", "s3:///x", "gs://bucket/x", "s3://user@bucket/x", "s3://b/x?y=1"])
def test_other_urls_are_refused(where: str) -> None:
    with pytest.raises(SurveyError, match="BUCKET/PREFIX"):
        place_of(where)


def test_a_bucket_that_is_not_there_is_named(s3: S3) -> None:  # noqa: ARG001
    with pytest.raises(SurveyError, match="no such bucket"):
        create_store(REQUEST, "s3://nobody/survey.zarr")
