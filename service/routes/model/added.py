"""The parameters that models add to δ, ε and β, in queries and in answers."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

from fastapi import Query
from pydantic import BaseModel, Field, create_model

from rattle.models import ADDED, DEFAULT_MODEL, model_of_parameter

Route = TypeVar("Route", bound=Callable[..., Any])


def annotate_added_parameter_query(name: str, without: str = DEFAULT_MODEL, example: float | None = None) -> Any:
    """Return the annotated type of a query parameter of a route: the parameter `name` that a model adds.

    without: words after "else" in the description: the model that the route uses if a request lacks this parameter.
    """
    each = ADDED[name]
    upper = each.greatest if math.isfinite(each.greatest) else None
    words = f"of {each.of}" if each.of else each.label
    text = f"{words}: the {model_of_parameter(name).name} model; else {without}"
    above, least = (None, 0) if each.may_be_zero else (0, None)
    examples = None if example is None else [example]
    query = Query(gt=above, ge=least, le=upper, allow_inf_nan=False, description=text, examples=examples)
    return Annotated[float | None, query]


def machine_number_descriptions() -> dict[str, str]:
    """Return {name: description} of the numbers of a machine that select another model, such as `stiffness`."""
    return {
        each.machine_number: f"{each.machine_text}: the {model_of_parameter(name).name} model"
        for name, each in ADDED.items()
        if each.machine_number is not None
    }


def with_query_parameters(after: dict[str, dict[str, Any]]) -> Callable[[Route], Route]:
    """Give a route further query parameters, which are None by default. The route gets them as keyword arguments.

    Parameters
    ----------
    after : dict of str to dict
        {parameter of the route: {name: annotated type} of the query parameters to add after it}.

    Returns
    -------
    Callable[[Route], Route]
        A decorator of the route.
    """

    def add_queries(route: Route) -> Route:
        signature = inspect.signature(route, eval_str=True)
        taken = []
        for own in signature.parameters.values():
            if own.kind is inspect.Parameter.VAR_KEYWORD:
                continue
            taken.append(own)
            for name, kind in after.get(own.name, {}).items():
                taken.append(inspect.Parameter(name, own.kind, default=None, annotation=kind))
        route.__signature__ = signature.replace(parameters=taken)  # type: ignore[attr-defined]
        return route

    return add_queries


def add_parameter_fields(base: type[BaseModel]) -> Any:
    """Return a subclass of a document with a further field for each parameter that a model adds."""
    fields: dict[str, Any] = {
        name: (float | None, Field(description=f"{each.full_label}; null: the {DEFAULT_MODEL} model"))
        for name, each in ADDED.items()
    }
    return create_model(f"_{base.__name__}", __base__=base, **fields)


def added_fields(numbers: dict[str, float]) -> dict[str, float | None]:
    """Return the fields that `add_parameter_fields` adds, with None for parameters that the model does not have."""
    return {name: numbers.get(name) for name in ADDED}
