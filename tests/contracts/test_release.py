"""The documents of a release, and the command where only the library is installed."""

import ast
import pickle
import re
import subprocess
import sys
import tomllib
import traceback
from importlib.metadata import metadata
from pathlib import Path

import pytest
import yaml

import gear_rattle
import rattle
from gear_rattle.service.client import Client

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def said_by(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code, *arguments], cwd=ROOT, capture_output=True, text=True)


def test_the_citation_is_of_this_version_and_licence() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["version"] == rattle.__version__ == metadata("gear-rattle")["Version"]
    assert cited["license"] == PROJECT["license"] == "BSD-3-Clause"
    assert "BSD 3-Clause" in (ROOT / "LICENSE").read_text()
    assert cited["authors"] == PROJECT["authors"]
    assert all(rattle_url.startswith("https://doi.org/") for rattle_url in PROJECT["urls"].values())


def test_the_version_is_said_without_the_compiler() -> None:
    told = "import sys, atexit; atexit.register(lambda: print('numba' in sys.modules))"
    done = said_by(f"{told}; from gear_rattle.cli import main; main()", "--version")
    assert done.stdout.split() == ["rattle", rattle.__version__, "False"], done.stderr


def test_the_command_without_its_extra_says_which() -> None:
    done = said_by("import sys; sys.modules['typer'] = None; from gear_rattle.cli import main; main()", "run")
    assert done.returncode == 2
    assert "pip install 'gear-rattle[cli]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_what_else_is_missing_is_told_as_it_is() -> None:
    done = said_by(
        "import sys; sys.modules['gear_rattle.service.cli'] = None; from gear_rattle.cli import main; main()", "run"
    )
    assert "ModuleNotFoundError" in done.stderr


def test_the_face_has_what_it_lists() -> None:
    assert all(getattr(gear_rattle, name) for name in gear_rattle.__all__)
    assert gear_rattle.Client is Client
    assert dir(gear_rattle) == gear_rattle.__all__


@pytest.mark.parametrize("name", [each for each in gear_rattle.__all__ if each.endswith("Error")])
def test_errors_are_those_of_the_face(name: str) -> None:
    """In tracebacks, and between processes."""
    kind = getattr(gear_rattle, name)
    assert issubclass(kind, rattle.RattleError)
    assert f"{kind.__module__}.{kind.__qualname__}" == f"gear_rattle.{name}"
    error = kind(503, "away", {}) if name == "ResponseError" else kind("away")
    assert traceback.format_exception_only(error) == [f"gear_rattle.{name}: away\n"]
    assert pickle.loads(pickle.dumps(kind)) is kind
    assert name in Path("docs/reference/api.md").read_text()


def test_both_packages_have_one_name() -> None:
    """No module is imported, or named in text, without `gear_rattle` before it: under two names it would be two."""
    plain = re.compile(r"(service|workers)([.:][a-z_.:]+)?")
    for package in ("service", "workers", "gear_rattle"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                names += [each.name for each in node.names] if isinstance(node, ast.Import) else []
                assert not [each for each in names if plain.fullmatch(each)], path
                if isinstance(node, ast.Constant) and isinstance(node.value, str) and plain.fullmatch(node.value):
                    named = node.value.replace(":", ".").split(".")
                    assert not (ROOT / "/".join(named[:2])).with_suffix(".py").exists() or len(named) < 2, (path, named)
                    assert len(named) < 2 or not (ROOT / "/".join(named[:2])).is_dir(), (path, named)
