"""The options of a refined survey, and the conditions under which it can be refined."""

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from gear_rattle.workers.survey.axes import Real, Strict
from gear_rattle.workers.survey.values.schema import SAMPLED, Group
from rattle.models import MODELS, Capability, require_capability

BLOCK = 32  # cells along a side of a block; corners are at multiples of it, independent of tiles
AUDIT = 0.02  # default share of the filled cells


class Refine(Strict):
    """Options of a survey that computes cells coarsely first, and finely where motions differ; others are filled.

    audit: share of the filled cells that are computed as a check of how many are wrong. bound: upper bound, 95 % sure,
    that the share of wrong cells among the filled ones must meet; further cells are audited and computed until it is
    met, in the end all.
    """

    audit: Annotated[Real, Field(gt=0, le=1)] = AUDIT
    bound: Annotated[Real, Field(gt=0, lt=1)] | None = None


def _refine_or_not(value: Any) -> Any:
    """Read true as the default options, and false as none."""
    return (Refine() if value else None) if isinstance(value, bool) else value


RefineOrNot = BeforeValidator(_refine_or_not)


def require_refinable(quantities: Iterable[Group], model: str) -> None:
    """Raise ValueError unless these groups of variables can be filled in cells that are not computed."""
    groups = set(quantities)
    if not groups & {Group.REGION, *SAMPLED}:
        raise ValueError("refine compares regions or attractors: name one of these quantities, or leave out refine")
    for group in (Group.BASINS, Group.INTENSITY):
        if group in groups:
            raise ValueError(f"{group} cannot be filled from other cells: leave out this quantity, or leave out refine")
    if Group.ORBITS in groups:
        require_capability(Capability.FILLED_ORBITS, MODELS[model])
