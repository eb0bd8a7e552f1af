"""The models of the gear, with one interface: a folder or file here each, and its entry in `MODELS`.

What a model has beside δ, ε and β, and what else tells it from others, is on its class: nobody else compares names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rattle.errors import ParameterError, require_one_of
from rattle.models.impacting import Impacting
from rattle.models.inelastic import Inelastic
from rattle.models.model import AnyGear, Capability, Functions, Limits, Model
from rattle.models.stiff import Stiff
from rattle.parameters import BETA, Harmonic, Parameter, Parameters

#: All models by name; the first is the one that is meant where nothing says which.
MODELS: dict[str, type[Model]] = {
    Impacting.name: Impacting,
    Stiff.name: Stiff,
    Inelastic.name: Inelastic,
}  # more of them here
DEFAULT_MODEL = next(iter(MODELS))
#: What models add to δ, ε and β, by name: no two of them add the same.
ADDED: dict[str, Parameter] = {each.name: each for model in MODELS.values() for each in model.added}
#: The parameters that all cells of a plane have.
OTHERS = (BETA.name, *ADDED)


class CapabilityError(ParameterError):
    """Something that a model does not have; the message says which models have it."""

    code = "model_lacks_capability"


def owner_of(name: str) -> type[Model]:
    """Return the model that adds a parameter."""
    return next(model for model in MODELS.values() if name in {each.name for each in model.added})


def _needed_by(model: type[Model]) -> tuple[str, ...]:
    """Return the parameters without a default, which select a model."""
    return tuple(each.name for each in model.added if each.default is None)


def model_adding(names: Any) -> type[Model]:
    """Return the model that has these parameters beside δ, ε and β, and no other without a default.

    Returns
    -------
    type[Model]
        A class; the first model's if there are no names.

    Raises
    ------
    ParameterError
        No model has all of them.
    """
    wanted = set(names)
    for model in MODELS.values():
        needed = set(_needed_by(model))
        if needed <= wanted <= {each.name for each in model.added}:
            return model
    for name in wanted:
        require_one_of("a parameter", name, ADDED)
    given = " and ".join(sorted(wanted))
    for model in MODELS.values():
        if wanted <= {each.name for each in model.added}:
            raise ParameterError(
                f"{given} is a number of the {model.name} model: give {' and '.join(_needed_by(model))} too"
            )
    raise ParameterError(f"no model has {given} together: give those of one")


def model_of(beta: float = 0.6, **added: float | None) -> Model:
    """Return the model that has what is added; None stands for nothing. Raises ParameterError."""
    given: dict[str, Any] = {name: value for name, value in added.items() if value is not None}
    return model_adding(given)(beta, **given)


def with_harmonics(model: Model, harmonics: Sequence[Harmonic]) -> Model:
    """Return a model with these harmonics beside the first one of its forcing, if there are any.

    Returns
    -------
    Model
        The same model where there are none.

    Raises
    ------
    ParameterError
        The model takes none, or one is wrong; the message says what to do.
    """
    if not harmonics:
        return model
    if not model.takes_harmonics:
        able = next(each for each in MODELS.values() if each.takes_harmonics)
        needed = " and ".join(_needed_by(able))
        raise ParameterError(
            f"the {model.name} model takes no harmonics: leave them out, or give {needed}, which selects the "
            f"{able.name} one"
        )
    taking: Any = model
    return replace(taking, harmonics=tuple(harmonics))


def model_at(gear: AnyGear) -> Model:
    """Return the model that a gear is one point of."""
    return model_with(gear.parameters)


def model_with(parameters: Parameters, number: int = 0) -> Model:
    """Return the model that has the numbers of one of these points."""
    point = parameters.point(number)
    model = MODELS[parameters.model](**{name: point[name] for name in parameters.others})
    return with_harmonics(model, parameters.harmonics)


def gear_at(parameters: Parameters, number: int = 0) -> AnyGear:
    """Return the gear at one of these points."""
    return model_with(parameters, number).gear(float(parameters.delta[number]), float(parameters.epsilon[number]))


def lacking(capability: Capability, model: Model | type[Model]) -> CapabilityError:
    """Return the error that says that a model does not have something, and which have it."""
    having = [name for name, each in MODELS.items() if capability in each.has]
    words = capability[0].upper() + capability[1:]
    return CapabilityError(f"{words} known of the {' and '.join(having)} model only, not of the {model.name} one.")


def require_capability(capability: Capability, model: Model | type[Model]) -> None:
    """Raise CapabilityError unless a model has something."""
    if capability not in model.has:
        raise lacking(capability, model)


__all__ = [
    "ADDED",
    "BETA",
    "DEFAULT_MODEL",
    "MODELS",
    "OTHERS",
    "AnyGear",
    "Capability",
    "CapabilityError",
    "Functions",
    "Impacting",
    "Inelastic",
    "Limits",
    "Model",
    "Parameter",
    "Parameters",
    "Stiff",
    "gear_at",
    "lacking",
    "model_adding",
    "model_at",
    "model_of",
    "model_with",
    "owner_of",
    "require_capability",
    "with_harmonics",
]
