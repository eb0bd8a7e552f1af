"""`rattle verify --processes N` says what one process says, of whole, damaged and unfinished stores."""

from pathlib import Path

import pytest
from service_processes import finish

from gear_rattle.workers import SurveyError, examine, run_survey

SURVEY = {"delta": (0.5, 0.9, 7), "epsilon": (0.05, 0.2, 6), "quantities": ("region",), "tile": {"delta": 2, "epsilon": 2}}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("survey") / "survey.zarr"
    run_survey(out=path, **SURVEY).close()  # type: ignore[arg-type]
    return path


def assert_the_same(store: Path, status: int) -> None:
    one = finish("verify", str(store))
    assert one.returncode == status, one.stderr
    for processes in (2, 3, 50):  # more than there are tiles
        several = finish("verify", str(store), "--processes", str(processes))
        assert (several.returncode, several.stdout) == (one.returncode, one.stdout), several.stderr


def test_several_processes_say_what_one_says(store: Path) -> None:
    assert_the_same(store, 0)
    found = examine(store, 2)
    assert found == examine(store)
    assert len(found.done) == found.tiles == 12
    lost, other = sorted(store.glob("region/c/*/*"))[3:5]
    content = other.read_bytes()
    lost.unlink()
    other.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert_the_same(store, 1)
    damaged = examine(store, 2)
    assert damaged == examine(store)
    assert len(damaged.damaged) == 2


def test_no_store_is_the_same_error(tmp_path: Path) -> None:
    for processes in (1, 2):
        with pytest.raises(SurveyError, match="does not exist"):
            examine(tmp_path / "nothing", processes)
