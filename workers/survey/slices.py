"""Choose a slice of an opened survey with a third axis, and find the slice's model."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from gear_rattle.workers.errors import SurveyError
from gear_rattle.workers.survey.manifest import group_path
from gear_rattle.workers.survey.values.schema import FIXED
from rattle.models import Model, model_of, with_harmonics

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import xarray as xr


def require_slice(third_axis: Mapping[str, int], number: int | None) -> None:
    """Raise SurveyError unless `number` is the number of a slice, or None for a survey without a third axis.

    Parameters
    ----------
    third_axis : Mapping[str, int]
        The length of the third axis by its name, or an empty mapping.
    number : int | None
        The number of the slice, from 0; None for a survey without a third axis.

    Raises
    ------
    SurveyError
        There is no such slice, or the survey has slices and `number` is None.
    """
    if not third_axis and number is not None:
        raise SurveyError("this survey has no third axis: leave slice out")
    for name, length in third_axis.items():
        if number is None or not 0 <= number < length:
            raise SurveyError(f"this survey has {length} values of {name}: choose a slice from 0 to {length - 1}")


def third_axis_length(dataset: xr.Dataset) -> dict[str, int]:
    """Return {name: length} of an open survey's third axis; empty without a third axis."""
    return {name: dataset.sizes[name] for name in FIXED if name in dataset.sizes}


def select_slice(dataset: xr.Dataset, number: int | None = None) -> xr.Dataset:
    """Return slice `number`, from 0, of an open survey; for number None the survey, which must have no third axis."""
    third = third_axis_length(dataset)
    require_slice(third, number)
    return dataset.isel(dict.fromkeys(third, number))


def slice_group_path(number: int | None, group: str) -> str:
    """Return the path of a slice's group in the store. number: the slice; None for a survey without a third axis."""
    return group_path(() if number is None else (number,), group)


def slices_of(dataset: xr.Dataset) -> Iterator[xr.Dataset]:
    """Yield the slices of an open survey, or the survey itself if it has no third axis."""
    third = third_axis_length(dataset)
    for name, length in third.items():
        yield from (dataset.isel({name: number}) for number in range(length))
    if not third:
        yield dataset


def third_axis_value(dataset: xr.Dataset) -> dict[str, float]:
    """Return {name: value} of the third axis at a slice; empty for a survey without a third axis."""
    one = [name for name in FIXED if name in dataset.coords and not dataset[name].dims]
    return {name: dataset[name].item() for name in one if name not in dataset.attrs}


def surveyed_model(dataset: xr.Dataset) -> Model:
    """Return the model of an open survey without a third axis, or of one slice.

    The oldest stores do not name their model, and have the model's parameters as attributes instead of coordinates.

    Returns
    -------
    Model
        The model with its parameters and harmonics.

    Raises
    ------
    SurveyError
        The survey has a third axis.
    """
    require_slice(third_axis_length(dataset), None)
    given: dict[str, Any] = {
        name: dataset[name].item() if name in dataset.coords else dataset.attrs.get(name) for name in FIXED
    }
    model = model_of(**{name: float(value) for name, value in given.items() if value is not None})
    harmonics = json.loads(dataset.attrs.get("harmonics", "[]"))
    return with_harmonics(model, [(int(order), size, phase) for order, size, phase in harmonics])
