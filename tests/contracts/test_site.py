"""The site of `make docs`: every page is in it, what follows from the programs is whole, and links lead somewhere."""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest
from depth import deep
from typer.main import get_command

from gear_rattle.service.app import create_app
from gear_rattle.service.cli import app
from gear_rattle.service.settings import Settings
from gear_rattle.workers import QUANTITIES
from gear_rattle.workers.survey.values.quantities import REFINED

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(
    str(path.relative_to(DOCS).with_suffix(""))
    for path in DOCS.rglob("*.md")
    if not path.is_relative_to(DOCS / "decisions") and not path.is_relative_to(DOCS / "reference" / "generated")
)


@pytest.fixture(scope="module")
def generate() -> ModuleType:
    sys.path.insert(0, str(DOCS / "site"))
    try:
        import generate
    finally:
        sys.path.pop(0)
    return generate


def test_every_page_is_in_one_of_the_four_parts() -> None:
    toctrees = re.findall(r"```\{toctree\}\n(?::[^\n]*\n)*\n(.*?)```", (DOCS / "index.md").read_text(), re.DOTALL)
    assert len(toctrees) == 4
    listed = [page for tree in toctrees for page in tree.split()]
    written = {"reference/generated/rest", "reference/generated/cli", "reference/generated/store", "decisions/README"}
    assert sorted(set(listed) - written) == [page for page in PAGES if page != "index"]
    assert len(listed) == len(set(listed))


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files_that_are_there(page: str) -> None:
    path = DOCS / f"{page}.md"
    for link in re.findall(r"\]\((?!https?:|#)([^)#]+)(?:#[^)]*)?\)", path.read_text()):
        assert (path.parent / link).exists(), link
        assert "reference/generated" not in link, link  # which is in the site alone


def test_the_reference_names_every_call_command_and_variable(generate: ModuleType, tmp_path: Path) -> None:
    generate.main(tmp_path)
    rest, commands, store = ((tmp_path / f"{name}.md").read_text() for name in ("rest", "cli", "store"))
    calls = create_app(Settings(data=tmp_path, explorer=False)).openapi()["paths"]
    for path, methods in calls.items():
        for method in methods:
            assert f"\n## {method.upper()} `{path}`\n" in rest
    for name, command in get_command(app).commands.items():
        assert f"\n## `rattle {name}" in commands
        for option in command.params:
            assert option.name == "help" or f"| `{option.opts[0]}" in commands or option.param_type_name == "argument"
    for quantity in (*QUANTITIES, *REFINED):
        assert f"\n| `{quantity.name}` | " in store


@deep
@pytest.mark.skipif(find_spec("myst_nb") is None, reason="the extra docs is not installed")
def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """Notebooks are executed."""
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-d", str(tmp_path / "trees")]
    done = subprocess.run([*command, "-c", "docs/site", "docs", str(tmp_path / "html" / "site")], cwd=ROOT, check=False)
    assert done.returncode == 0
    assert "P(4,4,2)" in (tmp_path / "html" / "site" / "tutorials" / "first-survey.html").read_text()
