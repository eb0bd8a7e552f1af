"""A bound of the wrong share that is asked for: it is met, it holds, and neither tiles nor interruptions show."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from pydantic import ValidationError

from gear_rattle.workers import (
    SurveyRequest,
    complete,
    compute_tile,
    is_incomplete,
    open_survey,
    place_of,
    run_survey,
    tiles_of,
)
from gear_rattle.workers.bound import ROUNDS, lacks_wrong_cell_bound
from gear_rattle.workers.storage.location import StoreDirectory
from gear_rattle.workers.survey.refined.audit import (
    AUDIT_ATTRIBUTES,
    AUDITED,
    share_upper_bound,
    values_of_audit_attributes,
)
from gear_rattle.workers.survey.refined.rounds import (
    CHAOTIC,
    KINDS,
    AuditCounts,
    AuditRound,
    create_first_audit_round,
    next_audit_round,
    upper_bound_of_wrong_share,
)

pytestmark = pytest.mark.usefixtures("templates_once")

#: Its first round audits too few cells for its bound; tiles of one block.
REGIONS: dict[str, Any] = {
    "delta": (0.4, 1.0, 96),
    "epsilon": (0.005, 0.3, 70),
    "quantities": ("region",),
    "refine": {"audit": 0.001, "bound": 0.02},
    "tile": {"delta": 32, "epsilon": 32},
}
SAMPLED = SurveyRequest(
    delta=(0.45, 0.55, 40), epsilon=(0.1, 0.2, 40), quantities=("attractors",), initial_conditions={"count": 4},
    refine={"bound": 0.05}, tile={"delta": 32, "epsilon": 32},
)  # fmt: skip


def few_audited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gear_rattle.workers.survey.refined.rounds.FIRST_AUDIT_FACTOR", 0.1)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A survey that has met its bound."""
    path = tmp_path_factory.mktemp("bound") / "survey.zarr"
    with pytest.MonkeyPatch.context() as patch:
        few_audited(patch)
        run_survey(REGIONS, out=path).close()
    return path


def chunks(store: Path) -> dict[str, bytes]:
    """Return the files that tiles have written."""
    return {str(path.relative_to(store)): path.read_bytes() for path in store.rglob("c/**/*") if path.is_file()}


def test_the_bound_holds_whatever_is_wrong() -> None:
    """Rounds over cells of which some, by chance and by the kind of their leaf, are wrong: of surveys at most one in
    twenty may have more wrong than it says, and chance has three standard deviations.
    """
    rng = np.random.default_rng(8)
    missed = filling = 0
    for _ in range(300):
        kind = np.array([5, CHAOTIC + 5, CHAOTIC + 2])[rng.choice(3, 20_000, p=[0.6, 0.3, 0.1])]
        wrong = rng.random(kind.size) < rng.choice([0.0, 0.004, 0.02], 3)[np.searchsorted([5, 10, 13], kind)]
        draw, filled = rng.random(kind.size), np.ones(kind.size, bool)
        rounds = (create_first_audit_round(0.01, 0.004, kind.size),)
        while True:
            before = rounds[-2].draw_limit if len(rounds) > 1 else 0.0
            limit = np.where(kind >= CHAOTIC, rounds[-1].chaotic_leaf_size, rounds[-1].regular_leaf_size)
            filled &= limit < 1 << kind % CHAOTIC
            audited = filled & (before <= draw) & (draw < rounds[-1].draw_limit)
            after = filled & ~audited
            counts = AuditCounts(
                *(np.bincount(kind[of], minlength=KINDS) for of in (filled, audited, audited & wrong, after))
            )
            filled = after
            if (more := next_audit_round(0.004, rounds, counts)) is None:
                break
            rounds = (*rounds, more)
        assert len(rounds) <= 6
        upper = upper_bound_of_wrong_share(counts, len(rounds) - 1)
        assert upper <= 0.004
        missed += (wrong & filled).sum() > upper * filled.sum()
        filling += bool(filled.any())
    assert filling > 80
    assert missed <= 0.05 * filling + 3 * np.sqrt(0.05 * filling)


def test_rounds_go_on_until_the_bound_is_met(whole: Path) -> None:
    with open_survey(whole) as survey:
        told, rounds = survey.attrs, [None, *json.loads(survey.attrs[ROUNDS])]
        source, audit, leaf = (survey[name].values for name in ("source_level", "audit", "audit_leaf"))
    assert len(rounds) > 1
    assert told["refined_bound_asked"] == 0.02
    assert 0.0 < told["refined_wrong_share_upper"] <= 0.02
    now = leaf // KINDS == len(rounds) - 1
    assert told["refined_cells_filled"] == (source > 0).sum() == ((source > 0) & now).sum()
    assert told["refined_cells_audited"] == ((audit >= AUDITED) & now).sum() < (audit >= AUDITED).sum()


def test_a_bound_beyond_what_so_few_cells_can_tell_is_met_by_computing_all(tmp_path: Path) -> None:
    with run_survey({**REGIONS, "refine": {"bound": 1e-6}}, out=tmp_path / "survey.zarr") as survey:
        assert not survey.source_level.any()
        assert survey.attrs["refined_wrong_share_upper"] == survey.attrs["refined_cells_filled"] == 0.0
    assert not is_incomplete(SurveyRequest(**{**REGIONS, "refine": {"bound": 1e-6}}), tmp_path / "survey.zarr")


def test_wherever_it_is_killed_it_goes_on_to_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At each of its writes after the tiles, as a process that is killed leaves them; at every one, killed again."""
    few_audited(monkeypatch)
    put, left = StoreDirectory.put, [10**9]

    def killed(place: StoreDirectory, key: str, content: bytes) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt
        put(place, key, content)

    monkeypatch.setattr(StoreDirectory, "put", killed)
    run_survey(REGIONS, out=tmp_path / "whole").close()
    expected, writes = chunks(tmp_path / "whole"), 10**9 - left[0]
    tiles = SurveyRequest(**REGIONS).n_tiles * 6
    assert writes > tiles + 20
    left[0], starts = tiles, 0
    while True:
        starts += 1
        try:
            run_survey(REGIONS, out=tmp_path / "killed").close()
            break
        except KeyboardInterrupt:
            left[0] = 13 + starts  # enough for a tile and what was begun
    assert starts > 2
    assert chunks(tmp_path / "killed") == expected


def test_after_each_pause_it_goes_on_to_the_same_bytes(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Four tiles a turn, of which every one gets further; what follows the bound waits for it."""
    few_audited(monkeypatch)
    request, store = SurveyRequest(**REGIONS), tmp_path / "paused"
    with open_survey(whole) as survey:
        told, rounds = dict(survey.attrs), len(json.loads(survey.attrs[ROUNDS]))
    with monkeypatch.context() as patched:
        patched.setattr("gear_rattle.workers.run.complete", lambda *_: None)
        run_survey(REGIONS, out=store).close()
    monkeypatch.setattr(
        "gear_rattle.workers.completion.lacks_families",
        lambda *_: followed.append(lacks_wrong_cell_bound(request, store)),
    )
    followed: list[bool] = []
    turns = 0
    while lacks_wrong_cell_bound(request, store):
        assert turns <= rounds * request.n_tiles
        with place_of(store).lock_for_writing():
            complete(request, store, at_once=4, should_pause=lambda: True)
        turns += 1
    assert turns > rounds
    assert followed == [False]
    assert chunks(store) == chunks(whole)
    assert {name: zarr.open_group(store, mode="r").attrs[name] for name in AUDIT_ATTRIBUTES} == {
        name: told[name] for name in AUDIT_ATTRIBUTES
    }


@pytest.mark.parametrize("damaged", ["audit_leaf/c/1/1", "delta/c/0"])
def test_what_is_damaged_is_taken_through_all_rounds_again(
    damaged: str, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A tile, or what makes the root be written again."""
    few_audited(monkeypatch)
    with open_survey(whole) as survey:
        told = survey.attrs
    expected = chunks(whole)
    shutil.copytree(whole, tmp_path / "survey.zarr")
    (tmp_path / "survey.zarr" / damaged).write_bytes(b"damaged")
    with run_survey(REGIONS, out=tmp_path / "survey.zarr") as again:
        assert again.attrs == told
    assert chunks(tmp_path / "survey.zarr") == expected


def test_slices_that_audit_the_same_places_are_no_larger_a_sample() -> None:
    told = values_of_audit_attributes([[900, 50, 1], [800, 40, 3], [0, 0, 0]])
    assert (told["refined_cells_filled"], told["refined_cells_audited"]) == (1700, 90)
    assert told["refined_wrong_share_upper"] == share_upper_bound(3, 40)
    assert values_of_audit_attributes([[0, 0, 0]])["refined_wrong_share_upper"] == 0.0


def test_slices_that_are_told_together_audit_other_places() -> None:
    """Asked for a bound; without, a slice is the survey of its plane."""
    thirds = {**REGIONS, "beta": {"start": 0.6, "stop": 0.6 + 1e-9, "num": 2}, "tile": {}}
    bounded, plain = (
        [compute_tile(request, tile)[0]["audit"] for tile in tiles_of(request)[::3]]
        for request in (SurveyRequest(**{**thirds, "refine": {"audit": 0.5, **more}}) for more in ({"bound": 0.5}, {}))
    )
    assert (bounded[0] != bounded[1]).mean() > 0.1
    assert (plain[0] == plain[1]).all()


def test_tiles_do_not_show_after_any_round() -> None:
    """Two rounds of a sampled survey, the second of which computes chaotic leaves whole, in tiles of two shapes."""
    rounds = (AuditRound(0.3, 0, 0), AuditRound(0.4, 0, 4))
    found = []
    for request in (SAMPLED, SAMPLED.model_copy(update={"tile": SurveyRequest.model_fields["tile"].default})):
        whole: dict[str, np.ndarray] = {}
        for tile in tiles_of(request):
            for name, values in compute_tile(request, replace(tile, rounds=rounds))[0].items():
                grid = whole.setdefault(name, np.zeros((*values.shape[:-2], *request.shape), values.dtype))
                grid[tile.selection] = values
        found.append(whole)
    for name, values in found[0].items():
        assert values.tobytes() == found[1][name].tobytes(), name
    leaf, source = found[0]["audit_leaf"], found[0]["source_level"]
    assert set(np.unique(leaf[source > 0] // KINDS)) == {2}  # all that is filled has gone through both
    chaotic = (leaf % KINDS >= CHAOTIC) & (leaf // KINDS == 2)
    assert (leaf[chaotic] % CHAOTIC > 2).all()
    assert {0, 1, 2} == set(np.unique(leaf[found[0]["audit"] > 0] // KINDS))


@pytest.mark.parametrize("bound", [0, 1, -0.1, "1e-3"])
def test_what_no_bound_can_be_is_refused(bound: Any) -> None:
    with pytest.raises(ValidationError, match="bound"):
        SurveyRequest(**{**REGIONS, "refine": {"bound": bound}})


def test_a_store_tells_no_bound_before_it_is_met(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A tile that is computed again has gone through one round: the bound is of the tiles as they were."""
    few_audited(monkeypatch)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("gear_rattle.workers.completion.audit_until_bound_is_met", stop)
    with pytest.raises(KeyboardInterrupt):
        run_survey(REGIONS, out=tmp_path / "survey.zarr")
    assert not set(AUDIT_ATTRIBUTES) & set(zarr.open_group(tmp_path / "survey.zarr", mode="r").attrs)
    assert is_incomplete(SurveyRequest(**REGIONS), tmp_path / "survey.zarr")
