"""The parameters that models add to δ, ε and β. They are read without the library, so that commands start quickly."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple


class AddedParameter(NamedTuple):
    """A parameter that a model adds, with the fields of `rattle.parameters.Parameter` that command options need."""

    name: str
    model: str
    label: str
    of: str = ""
    is_axis: bool = True
    machine_number: str | None = None
    machine_text: str = ""
    machine_absent: str = ""

    @property
    def full_label(self) -> str:
        """The label, and the thing that has the parameter if the field `of` names it: "Restitution of impacts"."""
        words = f"{self.label} of {self.of}" if self.of else self.label
        return words[0].upper() + words[1:]

    @classmethod
    def from_declaration(cls, model: str, given: dict[str, Any]) -> AddedParameter:
        """Make a parameter from an entry of a model's declaration.toml. model: name of the model. given: the entry."""
        return cls(model=model, **{name: value for name, value in given.items() if name in cls._fields})


@cache
def added_parameters() -> dict[str, AddedParameter]:
    """Return the parameters that models add to δ, ε and β, by name."""
    library = find_spec("rattle")
    assert library is not None
    assert library.submodule_search_locations is not None
    found: dict[str, AddedParameter] = {}
    for place in library.submodule_search_locations:
        for path in sorted(Path(place).glob("models/*/declaration.toml")):
            declared = tomllib.loads(path.read_text(encoding="utf-8"))
            for each in declared["parameters"]:
                found[each["name"]] = AddedParameter.from_declaration(declared["model"], each)
    return found
