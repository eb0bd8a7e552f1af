"""How a survey is refined, as it is asked for, and what can be."""

from collections.abc import Iterable
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from gear_rattle.workers.survey.axes import Real, Strict
from gear_rattle.workers.survey.values.schema import SAMPLED, Group
from rattle.models import MODELS, Capability, require_capability

BLOCK = 32  # cells along a side of a block, whose corners are at its multiples whatever the tiles
AUDIT = 0.02  # of the filled cells


class Refine(Strict):
    """Cells that are computed coarse first, and finer where what exists differs; the others are filled.

    audit: the share of filled cells that are computed all the same, to tell how many are wrong. bound: the upper bound
    of the share of wrong cells among the filled ones that has to be met, 95 % sure; more are audited and computed until
    it is, in the end all.
    """

    audit: Annotated[Real, Field(gt=0, le=1)] = AUDIT
    bound: Annotated[Real, Field(gt=0, lt=1)] | None = None


def _refine_or_not(value: Any) -> Any:
    """Read true and false as short for the default, and for nothing."""
    return (Refine() if value else None) if isinstance(value, bool) else value


RefineOrNot = BeforeValidator(_refine_or_not)


def require_refinable(quantities: Iterable[Group], model: str) -> None:
    """Raise ValueError unless these groups of variables can be filled where they are not computed."""
    groups = set(quantities)
    if not groups & {Group.REGION, *SAMPLED}:
        raise ValueError("refine goes by regions or attractors: name one of these quantities, or leave refine out")
    for group in (Group.BASINS, Group.INTENSITY):
        if group in groups:
            raise ValueError(f"{group} are of each cell and cannot be filled: leave them out, or leave refine out")
    if Group.ORBITS in groups:
        require_capability(Capability.FILLED_ORBITS, MODELS[model])
