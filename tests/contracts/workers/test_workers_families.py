"""The families of a survey: those of the library, whatever its tiles, kept under its seals, joined anew if lost."""

import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
import zarr
from depth import deep
from pydantic import ValidationError
from written import compute_and_write_tile

import gear_rattle.workers.families.blocks
import rattle
from gear_rattle.workers import (
    Axis,
    StoreDirectory,
    SurveyError,
    SurveyRequest,
    create_store,
    examine,
    finish_store,
    join_attractors_of_survey,
    lacks_families,
    open_family,
    open_survey,
    run_tiles_in_this_process,
    tiles_done,
    tiles_of,
)
from gear_rattle.workers.storage.added import run_in_this_process
from gear_rattle.workers.survey.stored_families import EDGE_VARIABLES, FAMILY_VARIABLES

GROUPS = ("attractors", "lyapunov", "families")
TILES = ((12, 10), (5, 4), (3, 10))

pytestmark = pytest.mark.usefixtures("templates_once")


def survey(delta: int, epsilon: int, slots_by: str = "fraction", slots: int = 8) -> SurveyRequest:
    return SurveyRequest(
        delta=Axis(start=0.405, stop=0.5, num=12),
        epsilon=Axis(start=0.09, stop=0.14, num=10),
        quantities=GROUPS,
        initial_conditions={"count": 8},
        tile={"delta": delta, "epsilon": epsilon},
        slots_by=slots_by,
        slots=slots,
    )


def computed(request: SurveyRequest, path: Path) -> Path:
    create_store(request, path)
    for tile in tiles_of(request):
        if tile.index not in tiles_done(request, path):
            compute_and_write_tile(request, str(path), tile)
    return path


def finished(request: SurveyRequest, path: Path) -> Path:
    computed(request, path)
    if lacks_families(request, path):
        join_attractors_of_survey(request, path)
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
    names = {variable.name for variable in (*FAMILY_VARIABLES, *EDGE_VARIABLES)}
    assert set(families.data_vars) | set(families.coords) == names
    assert all({"long_name", "units"} <= set(values.attrs) for values in families.variables.values())


@pytest.mark.parametrize("tile", [TILES[1], pytest.param(TILES[2], marks=deep)])
def test_tiles_do_not_show(whole: Path, tmp_path: Path, tile: tuple[int, int]) -> None:
    assert_same(finished(survey(*tile), tmp_path / "survey.zarr"), whole)


def test_a_run_that_is_killed_while_it_joins_is_resumed(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    request, path = survey(*TILES[0]), tmp_path / "survey.zarr"
    computed(request, path)
    put, written = StoreDirectory.put, []

    def dying(self: StoreDirectory, key: str, content: bytes) -> None:
        if len(written) == 9:
            raise KeyboardInterrupt
        written.append(key)
        put(self, key, content)

    with monkeypatch.context() as patch:
        patch.setattr(StoreDirectory, "put", dying)
        with pytest.raises(KeyboardInterrupt):
            join_attractors_of_survey(request, path)
    assert len(written) == 9
    assert lacks_families(request, path)
    assert examine(path).is_whole
    assert_same(finished(request, path), whole)


@pytest.mark.parametrize(
    "lost", ["families/cells/c/0", pytest.param("attractor_family/c/0/0/0", marks=deep), "families/m/zarr.json"]
)
def test_damage_is_found_and_joined_anew(whole: Path, tmp_path: Path, lost: str) -> None:
    request = survey(*TILES[0])
    path = Path(shutil.copytree(whole, tmp_path / "survey.zarr"))
    assert examine(path).is_whole
    (path / lost).write_bytes(b"\0" + (path / lost).read_bytes()[1:])
    assert examine(path).template == (lost,)
    create_store(request, path)
    assert lacks_families(request, path)
    assert_same(finished(request, path), whole)
    assert examine(path).is_whole
    assert {"date_completed", "content_hash"} <= set(open_survey(path).attrs)


def test_a_family_is_a_map(whole: Path) -> None:
    """It includes orbits without a slot, whose multipliers are those of the equations of impact times."""
    request, (numbers, families) = survey(*TILES[0]), read(whole)
    delta, epsilon = request.delta.values(), request.epsilon.values()
    found = rattle.families_of(delta, epsilon, count=8)
    with open_survey(whole) as root:
        share = root.attractor_fraction.load()
    for number in (0, 1, 2, int(families.entered_family[0])):
        one = open_family(whole, number)
        assert np.allclose(one.fraction, found.fractions(number), rtol=1e-7, equal_nan=True)
        listed = share.where(numbers == number).sum("attractor", min_count=1)
        assert np.array_equal(listed.fillna(0.0), one.fraction.fillna(0.0))
        assert np.array_equal(one.attractors > 0, np.isfinite(one.fraction))
        there = np.isfinite(one.fraction)
        assert (one.fraction_upper > one.fraction).where(there & (one.fraction < 1), True).all()
        assert one.attrs["kind"] == rattle.KINDS[int(families.kind[number])]
        assert one.attrs["cells"] == int(there.sum()) == int(families.cells[number])
    assert one.attrs["label"] == f"P({one.attrs['m']},{one.attrs['n_plus']},{one.attrs['n_minus']})"
    assert (one.fraction == 0).any()
    for i, j in np.argwhere(there.values)[:4]:
        tau, v = float(one.phase[i, j]), float(one.velocity[i, j])
        orbit = rattle.periodic_orbit(delta[j], epsilon[i], tau, v, one.attrs["n_plus"])
        sizes = np.sort(abs(np.array(orbit.multipliers)))[::-1]
        assert np.allclose(one.multiplier[:, i, j], sizes, rtol=1e-5)


def test_what_is_no_family_is_refused(whole: Path, tmp_path: Path) -> None:
    for number in (-1, 10_000, 1.5):
        with pytest.raises(SurveyError, match="use a number from 0 to"):
            open_family(whole, number)
    plain = SurveyRequest(delta=Axis(start=0.5, stop=0.6, num=4), epsilon=Axis(start=0.1, stop=0.2, num=4))
    create_store(plain, tmp_path / "plain.zarr")
    with pytest.raises(SurveyError, match="has no families: compute a survey with --quantity families"):
        open_family(tmp_path / "plain.zarr", 0)


def by_family(tile: tuple[int, int] = TILES[0], slots: int = 8) -> SurveyRequest:
    return survey(*tile, "family", slots)


@pytest.fixture(scope="module")
def followed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished(by_family(), tmp_path_factory.mktemp("families") / "survey.zarr")


def slots_in(path: Path) -> xr.Dataset:
    with open_survey(path) as root:
        return root.drop_vars([name for name in root if "attractor" not in root[name].dims]).load()


def test_slots_follow_families(whole: Path, followed: Path) -> None:
    """A cell lists the same attractors, and every family with room is in one slot, quiet running in the first."""
    shares, families = slots_in(whole), slots_in(followed)
    names = [name for name in shares if shares[name].ndim == 3]
    assert len(names) > 8

    def cells(found: xr.Dataset) -> np.ndarray:
        stacked = np.stack([np.asarray(found[name], float) for name in names]).reshape(len(names), 8, -1)
        return np.array([cell[:, np.lexsort(np.nan_to_num(cell, nan=-1.0))].T for cell in np.moveaxis(stacked, 2, 0)])

    assert np.array_equal(cells(shares), cells(families), equal_nan=True)
    assert_same_table(whole, followed)
    numbers = families.attractor_family.values
    slots = {n: {int(slot) for slot in np.unique(np.nonzero(numbers == n)[0])} for n in np.unique(numbers) if n >= 0}
    assert slots[0] == {0}
    alone = {n for n, table in enumerate(read(whole)[1].monodromy.values) if not table}
    assert all(len(slots[n]) == 1 for n in alone & slots.keys())
    assert any(len({*np.nonzero(shares.attractor_family.values == n)[0]}) > 1 for n in slots)


@pytest.fixture(scope="module")
def apart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiles of that survey, in another shape, not joined."""
    return computed(by_family(TILES[1]), tmp_path_factory.mktemp("families") / "survey.zarr")


@pytest.mark.parametrize(("side", "rounds"), [(7, 1), (3, 2)])
def test_blocks_do_not_show(
    followed: Path, apart: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, side: int, rounds: int
) -> None:
    """In one piece, orbits go from cell to cell through the whole grid; in blocks, round by round. The numbers and the
    slots are the same to the bit.
    """
    request, path, done = by_family(TILES[1]), tmp_path / "survey.zarr", []

    def each(task: Callable[..., Any], *arguments: Any) -> list[Any]:
        done.append(task.__name__)
        return run_in_this_process(task, *arguments)

    monkeypatch.setattr(gear_rattle.workers.families.blocks, "SLOTS_OF_BLOCK", 8 * side**2)
    shutil.copytree(apart, path)
    join_attractors_of_survey(request, path, each)
    assert_same(path, followed)
    assert slots_in(path).equals(slots_in(followed))
    assert examine(path).is_whole
    assert done.count("continue_orbits_into_block") >= rounds
    assert [*(path / "families").glob("joining*")] == []
    assert (path / f"attractor_family/c/0/{9 // side}/{11 // side}").exists()


def assert_same_table(first: Path, second: Path) -> None:
    assert read(first)[1].equals(read(second)[1])


@deep
@pytest.mark.parametrize("tile", [pytest.param(TILES[1], marks=deep), TILES[2]])  # the former in blocks, above
def test_tiles_do_not_show_in_slots(followed: Path, tmp_path: Path, tile: tuple[int, int]) -> None:
    path = finished(by_family(tile), tmp_path / "survey.zarr")
    assert slots_in(path).equals(slots_in(followed))


def test_slots_that_are_few_are_shared(tmp_path: Path) -> None:
    """There are two slots: families without one of their own take free ones, and nothing is lost."""
    few = slots_in(finished(by_family(slots=2), tmp_path / "few.zarr"))
    shares = slots_in(finished(survey(*TILES[0], slots=2), tmp_path / "shares.zarr"))
    assert np.array_equal(np.sort(few.attractor_phase, axis=0), np.sort(shares.attractor_phase, axis=0), equal_nan=True)
    assert (few.attractor_family[0] <= 0).sum() > (shares.attractor_family[0] <= 0).sum()


def test_a_tile_that_was_being_moved_when_its_worker_died_is_moved_all_the_same(
    followed: Path, apart: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """dask does the task again, in another process: what is there then is of neither order."""
    request, path = by_family(TILES[1]), tmp_path / "survey.zarr"
    shutil.copytree(apart, path)
    put, died = StoreDirectory.put, []

    def dying(self: StoreDirectory, key: str, content: bytes) -> None:
        if key.startswith("attractor_phase") and not died:
            died.append(key)
            raise KeyboardInterrupt
        put(self, key, content)

    def each(task: Callable[..., Any], of: SurveyRequest, where: str, items: Sequence[Any]) -> list[Any]:
        try:
            return run_in_this_process(task, of, where, items)
        except KeyboardInterrupt:
            return run_in_this_process(task, of, where, items)

    monkeypatch.setattr(StoreDirectory, "put", dying)
    join_attractors_of_survey(request, path, each)
    assert died
    finish_store(path)
    assert examine(path).is_whole
    assert slots_in(path).equals(slots_in(followed))


@pytest.mark.parametrize("puts", [3, 14])
def test_slots_that_are_being_moved_when_a_run_is_killed(
    followed: Path, apart: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, puts: int
) -> None:
    request, path = by_family(TILES[1]), tmp_path / "survey.zarr"
    shutil.copytree(apart, path)
    put, written = StoreDirectory.put, []

    def dying(self: StoreDirectory, key: str, content: bytes) -> None:
        if len(written) == puts:
            raise KeyboardInterrupt
        written.append(key)
        put(self, key, content)

    with monkeypatch.context() as patch:
        patch.setattr(StoreDirectory, "put", dying)
        with pytest.raises(KeyboardInterrupt):
            join_attractors_of_survey(request, path)
    assert lacks_families(request, path)
    finished(request, path)
    assert examine(path).is_whole
    assert slots_in(path).equals(slots_in(followed))


@deep
def test_a_tile_that_is_computed_again_is_joined_again(followed: Path, apart: Path, tmp_path: Path) -> None:
    """Computed, its slots are by share: the families are taken from the store before, and come back after it."""
    request, path = by_family(TILES[1]), tmp_path / "survey.zarr"
    shutil.copytree(apart, path)
    finished(request, path)
    chunk = path / "attractor_m/c/0/0/1"
    chunk.write_bytes(b"\0" + chunk.read_bytes()[1:])
    missing = [tile for tile in tiles_of(request) if tile.index not in tiles_done(request, path)]
    assert len(missing) == 1
    run_tiles_in_this_process(request, path, missing, lambda _: None, lambda: False)
    assert lacks_families(request, path)
    assert examine(path).is_whole
    with open_survey(path) as root:
        assert "attractor_family" not in root
    finished(request, path)
    assert examine(path).is_whole
    assert slots_in(path).equals(slots_in(followed))


def test_slots_by_family_need_families() -> None:
    assert by_family().slots_follow_families
    assert SurveyRequest.model_validate(survey(*TILES[0]).model_dump() | {"slots_by": None}).slots_follow_families
    assert not survey(*TILES[0]).slots_follow_families
    assert by_family().content_hash() != survey(*TILES[0]).content_hash()
    with pytest.raises(ValidationError, match="slots_by family needs families: add families to quantities"):
        SurveyRequest(delta=by_family().delta, epsilon=by_family().epsilon, slots_by="family")


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


@pytest.mark.parametrize("named", [("families",), ("families", "lyapunov"), ("attractors", "families")])
def test_families_bring_what_they_are_made_from(named: tuple[str, ...]) -> None:
    """The same request however it is written, so the same survey of the same hash."""
    fields = survey(*TILES[0]).model_dump()
    whole = SurveyRequest.model_validate(fields | {"quantities": ("attractors", "lyapunov", "families")})
    request = SurveyRequest.model_validate(fields | {"quantities": named})
    assert request == whole
    assert request.content_hash() == whole.content_hash()
