"""The product stands on what other projects document: it reads none of their private names and overrides nothing else.

Exceptions are listed in public_ground.toml, each with its reason and the version that it was tested with.
"""

import ast
import importlib
import re
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatch
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
EXCEPTIONS = Path(__file__).with_name("public_ground.toml")
MOST_EXCEPTIONS = 5
ROOMS = {"rattle": "rattle", "workers": "gear_rattle.workers", "service": "gear_rattle.service"}
OURS = frozenset({"rattle", "gear_rattle"})

#: Names with an underscore that their project documents: of named tuples, of the components that Panel's users write.
DOCUMENTED_NAMES = frozenset({"_asdict", "_fields", "_field_defaults", "_make", "_replace", "_esm", "_stylesheets"})
#: A function of that kind, and settings that programs assign.
DOCUMENTED_PLACES = frozenset({"os._exit", "sys.stdout", "ctx.cap"})
#: Methods and attributes of a class that its project documents for a subclass to define.
DOCUMENTED_OVERRIDES = {
    "bokeh.application.handlers.handler.Handler": {"modify_document", "on_session_created"},
    "distributed.diagnostics.plugin.NannyPlugin": {"setup", "teardown"},
    "distributed.diagnostics.plugin.SchedulerPlugin": {"add_worker", "close", "remove_worker", "start", "transition"},
    "distributed.diagnostics.plugin.WorkerPlugin": {"setup", "teardown", "transition"},
    "enum.Enum": {"_generate_next_value_", "_missing_"},
    "json.encoder.JSONEncoder": {"default"},
    "logging.Filter": {"filter"},
    "logging.Formatter": {"format", "formatException", "formatMessage", "formatStack"},
    "logging.Handler": {"emit"},
    "panel.custom.ReactiveESM": {"_esm", "_stylesheets"},
    "prometheus_client.registry.Collector": {"collect", "describe"},
    "pydantic.main.BaseModel": {"model_config", "model_post_init"},
    "pydantic_settings.main.BaseSettings": {"settings_customise_sources"},
    "pythonjsonlogger.core.BaseJsonFormatter": {"add_fields", "process_log_record"},
    "rich.progress.ProgressColumn": {"render"},
    "typer.core.TyperGroup": {"get_command", "invoke", "list_commands"},
}


class Finding(NamedTuple):
    """A place that stands on something private of another project."""

    file: str
    line: int
    code: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.code}"


def is_private(name: str) -> bool:
    """Return whether a name begins with an underscore and is none of Python's protocols."""
    return name.startswith("_") and name.strip("_") != "" and not re.fullmatch(r"__\w+__", name)


@cache
def sources() -> dict[Path, ast.Module]:
    """Return the syntax trees of the product."""
    files = [*(file for room in ROOMS for file in (ROOT / room).rglob("*.py")), *(ROOT / "gear_rattle").glob("*.py")]
    return {file: ast.parse(file.read_text(encoding="utf-8")) for file in sorted(files)}


def names_defined(tree: ast.Module) -> set[str]:
    """Return the names that a file gives to functions, classes, arguments, variables and attributes of its classes."""
    found = set[str]()
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                found.add(name)
            case ast.arg(arg=name) | ast.Name(id=name, ctx=ast.Store()):
                found.add(name)
            case ast.Attribute(value=ast.Name(id="self" | "cls"), attr=name, ctx=ast.Store()):
                found.add(name)
    return found


@cache
def names_of_ours() -> frozenset[str]:
    """Return the names that the product defines anywhere."""
    return frozenset().union(*map(names_defined, sources().values()))


def private_names(file: str, tree: ast.Module) -> Iterator[Finding]:
    """Find private names of others that a file imports, reads or assigns, and anything that it assigns to their names.

    An attribute of `self` is ours if any file of ours defines its name, one of another object if the same file does.
    """
    here, foreign = names_defined(tree), set[str]()

    def found(node: ast.AST) -> Finding:
        return Finding(file, getattr(node, "lineno", 0), ast.unparse(node))

    for node in ast.walk(tree):
        match node:
            case ast.Import(names=aliases):
                for alias in aliases:
                    if (parts := alias.name.split("."))[0] not in OURS:
                        foreign.add(alias.asname or parts[0])
                        if any(map(is_private, parts)):
                            yield found(node)
            case ast.ImportFrom(module=str(module), names=aliases, level=0) if module.split(".")[0] not in OURS:
                foreign |= {alias.asname or alias.name for alias in aliases}
                if any(map(is_private, [*module.split("."), *(alias.name for alias in aliases)])):
                    yield found(node)
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Name(id=owner), attr=name, ctx=context) if owner in foreign:
                assigns = isinstance(context, ast.Store | ast.Del)
                if (assigns or is_private(name)) and f"{owner}.{name}" not in DOCUMENTED_PLACES:
                    yield found(node)
            case ast.Attribute(value=owner, attr=name) if is_private(name) and name not in DOCUMENTED_NAMES:
                known = names_of_ours() if ast.unparse(owner) in ("self", "cls", "super()") else here
                if name not in known:
                    yield found(node)
            case ast.Call(
                func=ast.Name(id="getattr" | "setattr" | "hasattr" | "delattr" as function),
                args=[owner, ast.Constant(value=str(name)), *_],
            ):
                is_theirs = isinstance(owner, ast.Name) and owner.id in foreign
                changes = function in ("setattr", "delattr") and is_theirs
                if changes or (is_private(name) and (is_theirs or name not in here)):
                    yield found(node)


def overrides(file: str, owner: object, body: list[ast.stmt]) -> Iterator[Finding]:
    """Find attributes of other projects' classes that classes of ours define anew, where that is not documented."""
    for node in body:
        if not isinstance(node, ast.ClassDef):
            continue
        ours = getattr(owner, node.name, None)
        if not isinstance(ours, type):  # in a branch for another version of Python
            continue
        bases = [base for base in ours.__mro__[1:-1] if base.__module__.split(".")[0] not in OURS]
        documented = set[str]()
        for base in bases:
            documented |= DOCUMENTED_OVERRIDES.get(f"{base.__module__}.{base.__qualname__}", set())
        for name in sorted(names_in(node) - documented):
            of = next((base for base in bases if name in vars(base)), None)
            if of is not None and not re.fullmatch(r"__\w+__", name):
                yield Finding(file, node.lineno, f"{node.name}.{name} overrides {of.__module__}.{of.__qualname__}")
        yield from overrides(file, ours, node.body)


def names_in(node: ast.ClassDef) -> set[str]:
    """Return the names that the body of a class defines."""
    found = set[str]()
    for each in node.body:
        match each:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                found.add(name)
            case ast.Assign(targets=targets):
                found |= {target.id for target in targets if isinstance(target, ast.Name)}
            case ast.AnnAssign(target=ast.Name(id=name)):
                found.add(name)
    return found


def module_of(file: Path) -> str:
    """Return the name that a file of the product is imported by."""
    room, *parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join([ROOMS.get(room, room), *(part for part in parts if part != "__init__")])


@cache
def exceptions() -> list[dict[str, str]]:
    """Return the exceptions that stand in the list."""
    listed: list[dict[str, str]] = tomllib.loads(EXCEPTIONS.read_text(encoding="utf-8"))["exceptions"]
    return listed


def is_excepted(finding: Finding) -> bool:
    """Return whether a finding stands in the list."""
    return any(fnmatch(finding.file, each["file"]) and re.search(each["code"], finding.code) for each in exceptions())


@cache
def findings() -> list[Finding]:
    """Return all that the product has of other projects' private parts."""
    found = list[Finding]()
    for file, tree in sources().items():
        name = file.relative_to(ROOT).as_posix()
        found += private_names(name, tree)
        if any(isinstance(node, ast.ClassDef) and node.bases for node in tree.body):
            found += overrides(name, importlib.import_module(module_of(file)), tree.body)
    return found


def test_nothing_private_of_another_project_is_used() -> None:
    assert not [str(each) for each in findings() if not is_excepted(each)]


def test_the_page_s_scripts_use_nothing_private_of_bokeh() -> None:
    scripts = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "service" / "explorer").rglob("*.js")}
    assert len(scripts) > 10
    private = re.compile(r"Bokeh\.require|\b(?!this\b)\w+\._\w")  # modules of BokehJS, and names with an underscore
    assert not {name: private.findall(script) for name, script in scripts.items() if private.search(script)}


def test_exceptions_are_few_have_a_reason_and_are_needed() -> None:
    assert len(exceptions()) <= MOST_EXCEPTIONS
    for each in exceptions():
        assert set(each) == {"file", "code", "project", "version", "reason"}
        assert re.fullmatch(r"\d+(\.\d+)+", each["version"]), each
        assert len(each["reason"]) > 20, each
        used = [one for one in findings() if fnmatch(one.file, each["file"]) and re.search(each["code"], one.code)]
        assert used, f"this exception is no longer needed: {each}"


@pytest.mark.parametrize(
    "code",
    [
        "import numba._helperlib",
        "from numba.core import _private",
        "from numba._devicearray import DeviceArray",
        "import panel as pn\npn.state._curdoc",
        "from bokeh.server import session\nsession._run_in_executor = None",
        "from bokeh.server import session\nsession.current_time = None",
        "from bokeh.server import session\nsetattr(session, 'current_time', None)",
        "def size_of(session):\n    return len(session._subscribed_connections)",
        "def size_of(session):\n    return getattr(session, '_subscribed_connections')",
        "class Ours(Theirs):\n    def ours(self):\n        return self._of_theirs_and_nowhere_in_ours",
    ],
)
def test_a_private_name_is_found(code: str) -> None:
    assert list(private_names("ours.py", ast.parse(code)))


@pytest.mark.parametrize(
    "code",
    [
        "from __future__ import annotations",
        "from rattle.numerics import _own",
        "import os\nos._exit(1)",
        "def moved(point):\n    return point._replace(x=1)",
        "class Ours:\n    _x = 1\n\n    def copy(self, other):\n        return other._x",
    ],
)
def test_a_public_name_is_not_found(code: str) -> None:
    assert not list(private_names("ours.py", ast.parse(code)))


def test_an_override_that_is_not_documented_is_found() -> None:
    code = "import logging\nclass Ours(logging.Handler):\n    def emit(self, record): ...\n    def acquire(self): ..."
    space: dict[str, object] = {}
    exec(code, space)
    owner = type("module", (), space)
    (found,) = overrides("ours.py", owner, ast.parse(code).body)
    assert found.code == "Ours.acquire overrides logging.Handler"
