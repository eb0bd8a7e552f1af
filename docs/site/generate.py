"""Pages of the reference that follow from the programs themselves: REST, the command line, what a store holds."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import typer.main

from gear_rattle.service.app import create_app
from gear_rattle.service.cli import app as command
from gear_rattle.service.settings import Settings
from gear_rattle.workers import QUANTITIES, Group
from gear_rattle.workers.survey.plane_curves import CURVE_VARIABLES, POINT_VARIABLES
from gear_rattle.workers.survey.stored_families import FAMILY_VARIABLES
from gear_rattle.workers.survey.values.quantities import COORDINATES, REFINED

STORE = """# What a store holds

One zarr v3 store a survey: a file for each variable and tile, Zstandard and CRC-32C. Attributes of the root tell the
request, the version of the code, the versions and the processor on which the last bits depend, the licence and how to
cite. A complex variable is two, `…_real` and `…_imag`; `gear_rattle.open_survey` makes one of them again. `status` says
which cells are computed: never the presence of a file. `manifest.json`, which is no part of the zarr hierarchy, holds
a digest of every file, for `rattle verify`.
"""
SCALARS = """`beta`, of the stiff model `kappa` too, are coordinates without a dimension; surveys over a machine have
`rpm` and `eccentricity` along δ and ε.

In a survey with a third axis the one of them that is an axis is a dimension, the first of every variable below but for
labels, with chunks of length 1: a tile lies in one slice. The groups `curves`, `codimension_two` and `families` are
then in `slices/NUMBER`, one for each slice from 0, which has `beta` and `kappa` as attributes."""


def main(where: Path) -> None:
    """Write the pages, each only if it has changed."""
    where.mkdir(exist_ok=True)
    pages = {"rest.md": rest(), "cli.md": command_line(), "store.md": store()}
    for name, text in pages.items():
        path = where / name
        if not path.exists() or path.read_text() != text:
            path.write_text(text)


def table(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(_cell(cell) for cell in line) + " |" for line in lines) + "\n"


def _cell(value: Any) -> str:
    return " ".join(str("" if value is None else value).split()).replace("|", "\\|")


def rest() -> str:
    """Every call of the OpenAPI document."""
    with tempfile.TemporaryDirectory() as directory:
        document = create_app(Settings(data=Path(directory), explorer=False)).openapi()
    parts = ["# REST", "", document["info"].get("summary", ""), ""]
    for path, calls in document["paths"].items():
        for method, call in calls.items():
            parts += [f"## {method.upper()} `{path}`", "", call.get("summary", ""), "", call.get("description", ""), ""]
            if fields := call.get("parameters"):
                rows = (
                    (f"`{each['name']}`", each["in"], _type(each["schema"]), each.get("description")) for each in fields
                )
                parts += [table(("parameter", "in", "type", ""), rows)]
            if "requestBody" in call:
                parts += ["Takes a body:", "", *_example(call["requestBody"]["content"])]
            answers = ((status, answer["description"]) for status, answer in call["responses"].items())
            parts += [table(("status", "answer"), answers)]
    return "\n".join(parts)


def _parameter(each: dict[str, Any]) -> tuple[Any, ...]:
    return f"`{each['name']}`", each["in"], _type(each["schema"]), each.get("description")


def _type(schema: dict[str, Any]) -> str:
    if "enum" in schema:
        return " ".join(f"`{value}`" for value in schema["enum"])
    if "anyOf" in schema:
        return " or ".join(_type(each) for each in schema["anyOf"] if each.get("type") != "null")
    kind = schema.get("type") or schema.get("$ref", "").rpartition("/")[2]
    return f"{kind}, {schema['default']} by default" if schema.get("default") is not None else kind


def _example(content: dict[str, Any]) -> list[str]:
    for media_type, each in content.items():
        examples = each.get("examples") or {}
        found = each.get("example", next((one.get("value") for one in examples.values()), None))
        if found is not None:
            return [f"```json\n{json.dumps(found, indent=2, ensure_ascii=False)}\n```", ""]
        return [f"`{media_type}`", ""]
    return []


def command_line() -> str:
    """Every command with its options, as `--help` has them."""
    group: Any = typer.main.get_command(command)
    parts = ["# Command line", "", "`rattle COMMAND --help` says the same.", ""]
    for name, each in _commands(group, "rattle"):
        parts += [f"## `{name}`", "", (each.help or "").strip(), ""]
        if each.epilog:
            parts += [f"Example: `{each.epilog.removeprefix('Example: ')}`", ""]
        rows = [(_option(option), getattr(option, "help", "") or "") for option in each.params if option.name != "help"]
        if rows:
            parts += [table(("", ""), rows)]
    return "\n".join(parts)


def _commands(group: Any, prefix: str) -> Iterable[tuple[str, Any]]:
    for name, each in group.commands.items():
        if hasattr(each, "commands"):
            yield from _commands(each, f"{prefix} {name}")
        else:
            yield f"{prefix} {name}", each


def _option(option: Any) -> str:
    if option.param_type_name == "argument":
        return f"`{option.metavar or option.name}`"
    return f"`{', '.join(option.opts)}`"


def store() -> str:
    """Return the page on the contents of a store, from the registry."""
    labels = ((f"`{name}`", each.long_name, ", ".join(map(str, each.values))) for name, each in COORDINATES.items())
    parts = [STORE, "## Dimensions", "", table(("dimension", "", "labels"), labels), SCALARS, ""]
    for group in (*Group, None):
        found = [each for each in QUANTITIES if each.group is group]
        if found:
            parts += [f"## Group `{group}`" if group else "## In every survey", "", _variables(found)]
    parts += ["## In surveys that are refined", "", _variables(REFINED)]
    for title, variables in (
        ("curves/NAME", CURVE_VARIABLES),
        ("codimension_two", POINT_VARIABLES),
        ("families", FAMILY_VARIABLES),
    ):
        rows = ((f"`{each.name}`", ", ".join(each.dims), each.long_name) for each in variables)
        parts += [f"## `{title}`", "", table(("variable", "dimensions", ""), rows)]
    return "\n".join(parts)


def _variables(quantities: Iterable[Any]) -> str:
    rows = ((f"`{each.name}`", ", ".join(each.dims), each.dtype, _meaning(each), each.reference) for each in quantities)
    return table(("variable", "dimensions", "type", "", "source"), rows)


def _meaning(quantity: Any) -> str:
    codes = ", ".join(f"{code} {flag}" for code, flag in enumerate(quantity.flags))
    return f"{quantity.long_name}: {codes}" if codes else quantity.long_name


if __name__ == "__main__":
    main(Path(__file__).parents[1] / "reference" / "generated")
