"""The options of a refined survey, and the conditions under which it can be refined."""

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from gear_rattle.workers.survey.axes import Real, StrictRecord
from gear_rattle.workers.survey.values.schema import SAMPLED, Group
from rattle.models import MODELS, Capability, require_capability

BLOCK = 32  # cells along a side of a block; blocks begin at rows and columns that are multiples of this number
AUDITED_SHARE = 0.02  # default of `RefineOptions.audit`, the share of filled cells to audit


class RefineOptions(StrictRecord):
    """Options of a refined survey, which computes some cells, more cells where motions differ, and fills the others.

    audit: share of the filled cells that are computed as a check, to estimate how many filled cells are wrong. bound:
    the largest allowed share of wrong cells among the filled ones, with 95 % confidence, or None. With a bound, the
    survey audits and computes further cells until the bound is met, if necessary all cells.
    """

    audit: Annotated[Real, Field(gt=0, le=1)] = AUDITED_SHARE
    bound: Annotated[Real, Field(gt=0, lt=1)] | None = None


def _replace_bool_by_options(value: Any) -> Any:
    """Return the default options if the value is True, None if it is False, and any other value unchanged."""
    return (RefineOptions() if value else None) if isinstance(value, bool) else value


RefineOrNot = BeforeValidator(_replace_bool_by_options)


def require_refinable(quantities: Iterable[Group], model: str) -> None:
    """Raise ValueError unless a refined survey of this model can have these groups of variables."""
    groups = set(quantities)
    if not groups & {Group.REGION, *SAMPLED}:
        raise ValueError(
            "refine compares regions or attractors: add region or attractors to quantities, or leave out refine"
        )
    for group in (Group.BASINS, Group.INTENSITY):
        if group in groups:
            raise ValueError(f"{group} cannot be filled from other cells: leave out {group}, or leave out refine")
    if Group.ORBITS in groups:
        require_capability(Capability.FILLED_ORBITS, MODELS[model])
