"""The Python code of the documentation runs as a reader saves it: as a script without an `if __name__` guard."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from depth import deep
from service_processes import ENVIRONMENT, ROOT
from waiting import HANG

FEW = [(r", 61\)", ", 3)"), (r", 60\)", ", 3)"), (r", 31\)", ", 3)"), (r", 30\)", ", 3)")]
#: Options of a survey with families, which one document assumes.
WITH_FAMILIES = [*FEW, (r'out="backlash', 'quantities=("region", "attractors", "lyapunov", "families"), out="backlash')]
#: Enough cells along δ for levels and for a cluster, and few along ε.
LONG = [(r", 61\), epsilon=\(0.005, 0.3, 60\)", ', 513), epsilon=(0.005, 0.3, 2), initial_conditions={"count": 4}')]
SURVEY = "from gear_rattle import run_survey\nrun_survey(delta=(0.5, 0.7, 4), epsilon=(0.05, 0.15, 4), out={!r}, {})\n"
FAMILIES = 'quantities=("attractors", "lyapunov", "families"), cluster=1'
#: By document: replacements of placeholders in its code, and a script that runs before it.
DOCUMENTS = [
    pytest.param("docs/how-to/surveys.md", LONG, "", id="surveys"),
    pytest.param("README.md", FEW, "", id="readme", marks=deep),
    pytest.param("docs/how-to/third-axis.md", WITH_FAMILIES, "", id="third-axis", marks=deep),
    pytest.param("docs/how-to/library.md", [], "", id="library", marks=deep),
    pytest.param("docs/families.md", [], SURVEY.format("survey.zarr", FAMILIES), id="families", marks=deep),
    pytest.param("docs/refined.md", [], SURVEY.format("plane.zarr", "refine=True"), id="refined", marks=deep),
    pytest.param(
        "docs/resilience.md",
        [],
        "import numpy as np, rattle\ngear = rattle.Gear(0.6, 0.089)\n",
        id="resilience",
        marks=deep,
    ),
    pytest.param("docs/proofs.md", [], SURVEY.format("survey.zarr", "certify=True"), id="proofs", marks=deep),
]
#: Documents that are not run here: test_engineers.py runs one, test_map.py carries out a recipe, and the others need a
#: service, a bucket or an existing cluster.
ELSEWHERE = {"docs/engineers.md", "docs/map.md", "docs/how-to/service.md", "docs/operations.md"}


def python_of(document: str) -> str:
    return "\n".join(re.findall(r"```python\n(.*?)```", (ROOT / document).read_text(), re.DOTALL))


@pytest.mark.parametrize(("document", "replaced", "first"), DOCUMENTS)
def test_a_document_runs_as_a_file(tmp_path: Path, document: str, replaced: list[tuple[str, str]], first: str) -> None:
    text = python_of(document)
    for pattern, instead in replaced:
        text = re.sub(pattern, instead, text)
    file = tmp_path / "document.py"
    file.write_text(first + text)
    environment = ENVIRONMENT | {"MPLBACKEND": "agg"}
    command = [sys.executable, str(file)]
    ran = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=HANG)
    assert ran.returncode == 0, ran.stderr
    assert "Nanny" not in ran.stderr


def test_no_document_with_python_is_left_out() -> None:
    every = {os.path.relpath(path, ROOT) for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]}
    found = {name for name in every if python_of(name)}
    assert found == {str(each.values[0]) for each in DOCUMENTS} | ELSEWHERE
