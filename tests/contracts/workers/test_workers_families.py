"""The families of a survey: those of the library, whatever its tiles, kept under its seals, joined anew if lost."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from pydantic import ValidationError

import rattle
from workers import (
    Axis,
    Directory,
    SurveyRequest,
    create_store,
    examine,
    finish_store,
    join_survey,
    lacks_families,
    open_survey,
    tiles_done,
    tiles_of,
)
from workers.cluster.runner import compute_and_write
from workers.survey.families import FAMILY_VARIABLES
from workers.survey.request import MAX_JOINED

GROUPS = ("attractors", "lyapunov", "families")
TILES = ((12, 10), (5, 4), (3, 10))


def survey(delta: int, epsilon: int) -> SurveyRequest:
    return SurveyRequest(
        delta=Axis(start=0.405, stop=0.5, num=12),
        epsilon=Axis(start=0.09, stop=0.14, num=10),
        quantities=GROUPS,
        initial_conditions={"count": 8},
        tile={"delta": delta, "epsilon": epsilon},
    )


def computed(request: SurveyRequest, path: Path) -> Path:
    create_store(request, path)
    for tile in tiles_of(request):
        if tile.index not in tiles_done(request, path):
            compute_and_write(request, str(path), tile)
    return path


def finished(request: SurveyRequest, path: Path) -> Path:
    computed(request, path)
    if lacks_families(request, path):
        join_survey(request, path)
    finish_store(path)
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(survey(*TILES[0]), tmp_path_factory.mktemp("families") / "survey.zarr")


def read(path: Path) -> tuple[xr.DataArray, xr.Dataset]:
    with xr.open_zarr(path, chunks=None) as root, xr.open_zarr(path, group="families", chunks=None) as families:
        return root["attractor_family"].load(), families.load()


def assert_same(first: Path, second: Path) -> None:
    (numbers, families), (others, again) = read(first), read(second)
    assert numbers.equals(others)
    assert families.equals(again)


def test_they_are_those_of_the_library(whole: Path) -> None:
    request = survey(*TILES[0])
    delta, epsilon = request.delta.values(), request.epsilon.values()
    found = rattle.families_of(delta, epsilon, count=8)
    numbers, families = read(whole)
    assert (numbers.dims, numbers.dtype) == (("attractor", "epsilon", "delta"), np.dtype("int32"))
    rows, in_slots = found.attractors, found.family[~found.entered]
    cell = rows.cell[~found.entered]
    for i in range(request.n_cells):
        listed = in_slots[cell == i][: request.n_slots]
        here = numbers.values[(slice(None), *divmod(i, delta.size))]
        assert np.array_equal(here, np.pad(listed, (0, request.n_slots - listed.size), constant_values=-1))
    for name in ("cells", "kind", "m", "unsampled", "largest_fraction", "delta_at", "monodromy", "exponent"):
        assert np.array_equal(families[name], getattr(found.table, name), equal_nan=name == "exponent"), name
    assert found.entered.sum() == families.sizes["entered"] > 0
    assert np.array_equal(families.entered_velocity, rows.v[found.entered])
    at = families.entered_row * delta.size + families.entered_column
    assert np.array_equal(at, rows.cell[found.entered])
    assert set(families.data_vars) | set(families.coords) == {variable.name for variable in FAMILY_VARIABLES}
    assert all({"long_name", "units"} <= set(values.attrs) for values in families.variables.values())


@pytest.mark.parametrize("tile", TILES[1:])
def test_tiles_do_not_show(whole: Path, tmp_path: Path, tile: tuple[int, int]) -> None:
    assert_same(finished(survey(*tile), tmp_path / "survey.zarr"), whole)


def test_a_run_that_is_killed_while_it_joins_is_resumed(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    request, path = survey(*TILES[0]), tmp_path / "survey.zarr"
    computed(request, path)
    put, written = Directory.put, []

    def dying(self: Directory, key: str, content: bytes) -> None:
        if len(written) == 9:
            raise KeyboardInterrupt
        written.append(key)
        put(self, key, content)

    with monkeypatch.context() as patch:
        patch.setattr(Directory, "put", dying)
        with pytest.raises(KeyboardInterrupt):
            join_survey(request, path)
    assert len(written) == 9
    assert lacks_families(request, path)
    assert examine(path).whole
    assert_same(finished(request, path), whole)


@pytest.mark.parametrize("lost", ["families/cells/c/0", "attractor_family/c/0/0/0", "families/m/zarr.json"])
def test_damage_is_found_and_joined_anew(whole: Path, tmp_path: Path, lost: str) -> None:
    request = survey(*TILES[0])
    path = finished(request, tmp_path / "survey.zarr")
    assert examine(path).whole
    (path / lost).write_bytes(b"\0" + (path / lost).read_bytes()[1:])
    assert examine(path).template == (lost,)
    create_store(request, path)
    assert lacks_families(request, path)
    assert_same(finished(request, path), whole)
    assert examine(path).whole
    assert {"date_completed", "content_hash"} <= set(open_survey(path).attrs)


def test_readers_see_them_in_the_metadata_of_the_root(whole: Path) -> None:
    groups = zarr.open_consolidated(whole)
    assert groups["families/cells"].shape == groups["families/family"].shape
    assert sum(groups["families/unsampled"]) > 0


def test_who_does_not_ask_has_none(tmp_path: Path) -> None:
    request = survey(*TILES[0])
    assert "families" not in SurveyRequest(delta=request.delta, epsilon=request.epsilon).quantities
    plain = SurveyRequest(delta=request.delta, epsilon=request.epsilon, quantities=("region",))
    create_store(plain, tmp_path / "survey.zarr")
    assert not lacks_families(plain, tmp_path / "survey.zarr")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"quantities": ("families",)}, "families are made from attractors and lyapunov"),
        ({"quantities": ("attractors", "families")}, "families are made from attractors and lyapunov"),
        ({"delta": {"start": 0.4, "stop": 1.0, "num": MAX_JOINED // 10 + 1}, "tile": {}}, "families of 1500010 cells"),
    ],
)
def test_what_cannot_be_joined_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        SurveyRequest.model_validate(survey(*TILES[0]).model_dump() | change)
