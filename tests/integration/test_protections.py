"""Every protection in `mutations.py` can be taken out of the present code, and its test exists."""

import re
import shutil
from pathlib import Path

import pytest
from mutations import PROTECTIONS, Protection

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("protection", PROTECTIONS, ids=lambda protection: protection.name)
def test_it_can_be_taken_out(protection: Protection, tmp_path: Path) -> None:
    for file in {edit.file for edit in protection.edits}:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / file, tmp_path / file)
    for edit in protection.edits:
        edit.apply(tmp_path)
        compile((tmp_path / edit.file).read_text(), edit.file, "exec")
    path, _, function = protection.test.partition("::")
    text = (ROOT / path).read_text()
    quick = set(re.findall(r"^def (test_\w+)", text, re.M)) - set(
        re.findall(r"^@deep\n(?:@.*\n)*def (\w+)", text, re.M)
    )
    assert quick & ({function} if function else quick)


def test_every_file_of_faults_has_one() -> None:
    tested = {protection.test.partition("::")[0] for protection in PROTECTIONS}
    assert {str(path.relative_to(ROOT)) for path in (ROOT / "tests/integration").glob("test_faults_*.py")} <= tested
