"""Processes of this project import neither the working directory nor a script's."""

import ast
import os
import sys
from pathlib import Path

import pytest

from rattle.numerics.processes import SAFE_PATH, child_process_environment, trusted_import_directories

ROOT = Path(__file__).parents[3]
#: Files that start processes by a library, which inherit the environment of the command or the service.
BY_A_LIBRARY = {"service/kernels.py", "service/operations/crises.py", "service/operations/processes.py"}
MEASURES = {"service/bench/measure.py"}  # of the command only, which sets the variable
STARTERS = {"subprocess", "multiprocessing", "to_process", "ProcessPoolExecutor", "create_subprocess_exec"}


def test_a_copy_that_is_the_working_directory_hides_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copy = tmp_path / "copy"
    (copy / "rattle").mkdir(parents=True)
    monkeypatch.chdir(copy)
    monkeypatch.setattr(sys, "path", ["", "relative", str(copy), str(tmp_path), *sys.path])
    path = trusted_import_directories()
    assert str(copy) not in path
    assert str(tmp_path) in path
    assert str(ROOT) in path
    assert all(os.path.isabs(each) for each in path)


def test_children_run_the_code_that_this_process_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another installation, found elsewhere, comes after it; what the environment names is found too."""
    (tmp_path / "rattle").mkdir()
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "named"))
    assert trusted_import_directories() == [str(tmp_path / "named"), str(ROOT), str(tmp_path)]
    assert child_process_environment()[SAFE_PATH] == "1"
    assert child_process_environment()["PYTHONPATH"] == os.pathsep.join(trusted_import_directories())


def test_every_process_that_is_started_has_this_environment() -> None:
    found = set()
    for package in ("rattle", "workers", "service", "gear_rattle"):
        for path in (ROOT / package).rglob("*.py"):
            tree, name = ast.parse(path.read_text()), path.relative_to(ROOT).as_posix()
            if not STARTERS & names_of(tree) or name in MEASURES:
                continue
            found.add(name)
            for call in ast.walk(tree):
                if isinstance(call, ast.Call) and ast.unparse(call.func) in ("subprocess.Popen", "subprocess.run"):
                    given = {each.arg: ast.unparse(each.value) for each in call.keywords}
                    assert given.get("env") in ("child_process_environment()", "_environment()"), (name, call.lineno)
    own = {"rattle/numerics/compile.py", "workers/apart.py", "workers/cluster/cluster.py"}
    assert found == BY_A_LIBRARY | own | {"workers/cluster/isolation.py"}


def names_of(tree: ast.AST) -> set[str]:
    imports = [each for each in ast.walk(tree) if isinstance(each, ast.Import | ast.ImportFrom)]
    return {alias.name.partition(".")[0] for each in imports for alias in each.names} | {
        (each.module or "").partition(".")[0] for each in imports if isinstance(each, ast.ImportFrom)
    }
