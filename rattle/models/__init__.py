"""The models of the gear behind one interface. Each model has a folder here and an entry in `MODELS`.

The class of a model declares which parameters it has besides δ, ε and β, and which capabilities. Other code reads these
declarations and never compares names of models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rattle.errors import ParameterError, require_one_of
from rattle.models.impacting import Impacting
from rattle.models.inelastic import Inelastic
from rattle.models.model import AnalyticLimits, AnyGear, Capability, GearFunctions, Model
from rattle.models.stiff import Stiff
from rattle.parameters import BETA, Harmonic, Parameter, Parameters

#: All models by name; the first is the default.
MODELS: dict[str, type[Model]] = {
    Impacting.name: Impacting,
    Stiff.name: Stiff,
    Inelastic.name: Inelastic,
}  # a new model goes above this line
DEFAULT_MODEL = next(iter(MODELS))
#: The parameters that models have besides δ, ε and β, by name. No two models add the same parameter.
ADDED: dict[str, Parameter] = {each.name: each for model in MODELS.values() for each in model.added}
#: The names of all parameters besides δ and ε. All cells of a plane have the same values of these parameters.
OTHERS = (BETA.name, *ADDED)


class CapabilityError(ParameterError):
    """A model lacks a capability that the caller needs. The message names the models that have the capability."""

    code = "model_lacks_capability"


def model_of_parameter(name: str) -> type[Model]:
    """Return the model that adds the parameter `name`, a key of ADDED, to δ, ε and β."""
    return next(model for model in MODELS.values() if name in {each.name for each in model.added})


def _required_parameters(model: type[Model]) -> tuple[str, ...]:
    """Return the names of the added parameters without a default value; giving one of them selects the model."""
    return tuple(each.name for each in model.added if each.default is None)


def model_with_parameters(names: Any) -> type[Model]:
    """Return the model to which the parameters `names` belong, and whose other parameters have default values.

    Returns
    -------
    type[Model]
        The class of the model; the default model if there are no names.

    Raises
    ------
    ParameterError
        If no model has all of these parameters, or the model has another parameter without a default value.
    """
    wanted = set(names)
    for model in MODELS.values():
        needed = set(_required_parameters(model))
        if needed <= wanted <= {each.name for each in model.added}:
            return model
    for name in wanted:
        require_one_of("a parameter", name, ADDED)
    given = " and ".join(sorted(wanted))
    for model in MODELS.values():
        if wanted <= {each.name for each in model.added}:
            required = " and ".join(_required_parameters(model))
            raise ParameterError(
                f"{given} belongs to the {model.name} model, which needs {required}: give {required} too"
            )
    raise ParameterError(f"no model has {given} together: give the parameters of one model")


def model_of(beta: float = 0.6, **added: float | None) -> Model:
    """Return the model with half-backlash beta and the parameters `added`, where None counts as not given.

    Returns
    -------
    Model
        The model that has these parameters; the default model if all are None.

    Raises
    ------
    ParameterError
        If no model has the given parameters, or one is outside its domain.
    """
    given: dict[str, Any] = {name: value for name, value in added.items() if value is not None}
    return model_with_parameters(given)(beta, **given)


def with_harmonics(model: Model, harmonics: Sequence[Harmonic]) -> Model:
    """Return a copy of a model, with the given harmonics of the forcing besides the first harmonic.

    Returns
    -------
    Model
        The copy, or the model itself if `harmonics` is empty.

    Raises
    ------
    ParameterError
        If the model takes no harmonics, or a harmonic is invalid.
    """
    if not harmonics:
        return model
    if not model.takes_harmonics:
        able = next(each for each in MODELS.values() if each.takes_harmonics)
        needed = " and ".join(_required_parameters(able))
        raise ParameterError(
            f"the {model.name} model takes no harmonics: leave them out, or give {needed}, which selects the "
            f"{able.name} model"
        )
    taking: Any = model
    return replace(taking, harmonics=tuple(harmonics))


def model_of_gear(gear: AnyGear) -> Model:
    """Return the model of a gear."""
    return model_at_point(gear.parameters)


def model_at_point(parameters: Parameters, number: int = 0) -> Model:
    """Return the model at one of the points that `parameters` holds; number: the index of the point."""
    point = parameters.point(number)
    model = MODELS[parameters.model](**{name: point[name] for name in parameters.others})
    return with_harmonics(model, parameters.harmonics)


def gear_at_point(parameters: Parameters, number: int = 0) -> AnyGear:
    """Return the gear at one of the points that `parameters` holds; number: the index of the point."""
    return model_at_point(parameters, number).gear(float(parameters.delta[number]), float(parameters.epsilon[number]))


def missing_capability_error(capability: Capability, model: Model | type[Model]) -> CapabilityError:
    """Return the error for a capability that a model lacks. Its message names the models that have the capability."""
    having = [name for name, each in MODELS.items() if capability in each.has]
    words = capability[0].upper() + capability[1:]
    only = f"{' and '.join(having)} model{'s' if len(having) > 1 else ''}"
    return CapabilityError(f"{words} available only for the {only}, not for the {model.name} model.")


def require_capability(capability: Capability, model: Model | type[Model]) -> None:
    """Raise CapabilityError unless a model has a capability."""
    if capability not in model.has:
        raise missing_capability_error(capability, model)


__all__ = [
    "ADDED",
    "BETA",
    "DEFAULT_MODEL",
    "MODELS",
    "OTHERS",
    "AnalyticLimits",
    "AnyGear",
    "Capability",
    "CapabilityError",
    "GearFunctions",
    "Impacting",
    "Inelastic",
    "Model",
    "Parameter",
    "Parameters",
    "Stiff",
    "gear_at_point",
    "missing_capability_error",
    "model_at_point",
    "model_of",
    "model_of_gear",
    "model_of_parameter",
    "model_with_parameters",
    "require_capability",
    "with_harmonics",
]
