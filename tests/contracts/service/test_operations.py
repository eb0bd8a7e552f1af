"""docs/operations.md says what the code does: settings, queries, numbers of a large survey."""

import re
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families
from service_support import front_end

from gear_rattle.service.settings import Settings
from gear_rattle.workers import SurveyRequest
from gear_rattle.workers.survey.request import DEFAULT
from gear_rattle.workers.survey.values.quantities import stored_variables
from rattle.models import DEFAULT_MODEL

DOCUMENT = Path(__file__).parents[3] / "docs" / "operations.md"
TEXT = DOCUMENT.read_text()
BEGIN, END = (
    "<!-- settings: tests/contracts/service/test_operations.py writes this table -->\n",
    "<!-- end of settings -->",
)


def settings_table() -> str:
    """Every setting, its default and what it is."""
    rows = ["| variable | default | |", "|---|---|---|"]
    for name, field in Settings.model_fields.items():
        shown = "" if field.default in (None, (), "") else f"`{field.default}`"
        rows.append(f"| `RATTLE_{name.upper()}` | {shown} | {field.description or ''} |")
    return "\n".join(rows) + "\n"


def test_the_table_of_settings() -> None:
    written = TEXT.partition(BEGIN)[2].partition(END)[0]
    assert written == settings_table(), f"write this to {DOCUMENT.name}:\n{settings_table()}"


def test_every_setting_that_is_named_exists() -> None:
    others = {"RATTLE_API_KEY", "RATTLE_CACHE_DIR", "RATTLE_URL", "RATTLE_SITE", "RATTLE_PUBLISH", "RATTLE_FRONT"}
    others |= {"RATTLE_CLUSTER", "RATTLE_SHARED", "RATTLE_INTERFACE"}  # of deploy/slurm
    known = {f"RATTLE_{name.upper()}" for name in Settings.model_fields} | others
    assert set(re.findall(r"RATTLE_[A-Z_]+", TEXT)) <= known


def test_every_figure_that_is_named_is_told(tmp_path: Path) -> None:
    named = set(re.findall(r"\brattle_[a-z_]+", TEXT))
    with front_end(tmp_path) as client:
        client.get("/v1/health")
        told = client.get("/v1/metrics").text
    assert len(named) > 7
    assert named <= {sample.name for family in text_string_to_metric_families(told) for sample in family.samples}


def test_the_large_survey() -> None:
    axes = {
        "delta": {"start": 0.4, "stop": 1.0, "num": 31_623},
        "epsilon": {"start": 0.005, "stop": 0.3, "num": 31_623},
    }
    large = SurveyRequest(**axes, tile={"delta": 64, "epsilon": 64})
    per_cell = sum(each.is_per_cell for each in stored_variables(DEFAULT, DEFAULT_MODEL))
    assert f"{large.n_tiles:_}".replace("_", " ") in TEXT
    assert f"{SurveyRequest(**axes).n_tiles:_}".replace("_", " ") in TEXT
    (measured,) = map(int, re.findall(r"\| (\d+) per tile", TEXT))
    assert measured <= per_cell < 1.2 * measured  # a variable more or two change nothing that is said here
    assert f"in {measured} objects per tile" in TEXT
    assert large.n_tiles * measured == pytest.approx(7.1e6, rel=0.01)
    limits = {name.lower(): int(value) for name, value in re.findall(r"RATTLE_(MAX_[A-Z]+)=(\d+)", TEXT)}
    assert limits["max_cells"] >= large.n_cells
    assert limits["max_tiles"] >= large.n_tiles
    assert limits["max_samples"] >= large.n_cells * 64
    assert Settings().max_tile_samples >= 64 * 64 * 64
