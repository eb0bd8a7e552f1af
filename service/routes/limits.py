"""Compute the design limit of one number of a gear."""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from fastapi import APIRouter, Depends, Query
from pydantic import BaseModel, Field, ValidationError, ValidatorFunctionWrapHandler, WrapValidator

from gear_rattle.service.operations.points import finite_or_none
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.routes.model.added import with_query_parameters
from gear_rattle.service.routes.model.machine import ADDED_AND_MACHINE_QUERIES, declare_positive_query
from gear_rattle.service.routes.model.points import MostImpacts, SampleSeed, require_few_samples
from gear_rattle.service.state import FrontState
from gear_rattle.service.web.conditional import NOT_MODIFIED, set_query_etag
from gear_rattle.service.web.problems import declare_problems
from rattle import Limit, ParameterError, design_limit, design_limits
from rattle.attractors import BUDGET
from rattle.populations import MOST_SHARE, model_of_numbers

router = APIRouter(prefix="/v1", tags=["points"])

MOST_VALUES = 16
OrderName = Annotated[str, Field(pattern=r"^(harmonic|error)_[1-9]\d{0,2}$")]
NumberName = Literal[
    "epsilon",
    "delta",
    "beta",
    "load",
    "restitution",
    "eccentricity",
    "drag",
    "backlash",
    "rpm",
    "load_torque",
    "driven_eccentricity",
    "mesh_error",
    "mesh_error_2",
    "mesh_error_3",
]


def _validate_number_name(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
    try:
        return handler(value)
    except ValidationError as error:
        known = ", ".join(get_args(NumberName))
        raise ValueError(f"must be one of {known}, or an order such as harmonic_12 or error_12") from error


LimitedNumber = Annotated[NumberName | OrderName, WrapValidator(_validate_number_name)]
LIMITED_NUMBER = (
    "number to limit, which need not be given itself. harmonic_12 is the amplitude of order 12 divided by that of the "
    "first order, error_12 the amplitude of order 12 of a machine's transmission error in m"
)


class LimitDocument(BaseModel):
    """A design limit and its 95 % interval, in the unit of the limited number.

    A limit, or an end of its interval, that lies outside the searched range is null.
    """

    at: float | None = Field(description="value of the number `over`; null without `over`")
    value: float | None
    low: float | None
    high: float | None


class LimitsDocument(BaseModel):
    """The design limits of the number `of`, at the required probability `share` of quiet running."""

    of: LimitedNumber
    share: float
    count: int
    limits: list[LimitDocument]


@with_query_parameters({"beta": ADDED_AND_MACHINE_QUERIES})
async def numbers_of_query(
    delta: Annotated[float | None, declare_positive_query("damping", 0.6)] = None,
    epsilon: Annotated[float | None, declare_positive_query("eccentricity", zero=True)] = None,
    beta: Annotated[float | None, declare_positive_query("half-backlash, by default 0.6")] = None,
    **more: Any,
) -> dict[str, Any]:
    """Return the numbers of a gear or a machine that the query gives, by name."""
    numbers = {"delta": delta, "epsilon": epsilon, "beta": beta, **more}
    return {name: value for name, value in numbers.items() if value is not None}


@router.get(
    "/limits",
    summary="How far one number of a gear may go until it does not run quietly often enough",
    dependencies=[Depends(set_query_etag)],
    responses={**NOT_MODIFIED, **declare_problems(422)},
)
async def limits(
    front: FrontState,
    given: Annotated[dict[str, Any], Depends(numbers_of_query)],
    of: Annotated[LimitedNumber, Query(description=LIMITED_NUMBER, examples=["epsilon"])],
    share: Annotated[
        float, Query(gt=0, le=MOST_SHARE, description="least probability of quiet running", examples=[0.8])
    ] = 0.99,
    over: Annotated[LimitedNumber | None, Query(description="number over which the limit is a curve")] = None,
    values: Annotated[
        list[Annotated[float, Field(gt=0, allow_inf_nan=False)]] | None,
        Query(max_length=MOST_VALUES, description="values of that number; repeat the parameter for each"),
    ] = None,
    low: Annotated[float | None, declare_positive_query("least searched value", zero=True)] = None,
    high: Annotated[float | None, declare_positive_query("largest searched value")] = None,
    count: Annotated[int, Query(ge=1, description="initial conditions", examples=[64])] = 1024,
    budget: MostImpacts = BUDGET,
    seed: SampleSeed = 0,
) -> LimitsDocument:
    """Return the value of a number up to which a gear runs quietly with at least the probability `share`.

    The limit is the largest allowed eccentricity, mesh error, backlash, restitution or speed, or the least allowed
    damping, drag or load. For a machine a length is in metres, drag in N m s/rad, a load in N m.
    """
    require_few_samples(front, count)
    if (over is None) != (values is None):
        raise ParameterError("over and values belong together: give both or neither")
    if (low is None) != (high is None):
        raise ParameterError("low and high belong together: give both or neither")
    between = None if low is None or high is None else (low, high)
    found = await compute_in_process(
        front,
        compute_design_limits,
        *(given, of, share, over, values, between, count, seed, budget),
        model=model_of_numbers(given).name,
        what="The limits",
        advice="Request fewer initial conditions (count) or fewer values, or use the command rattle limit.",
    )
    at: list[float | None] = [*values] if values else [None]
    return LimitsDocument(
        of=of, share=share, count=count, limits=[_limit_document(*each) for each in zip(at, found, strict=True)]
    )


def compute_design_limits(
    given: dict[str, Any],
    of: str,
    share: float,
    over: str | None,
    values: list[float] | None,
    between: tuple[float, float] | None,
    count: int,
    seed: int,
    budget: int,
) -> list[Limit]:
    """Return the design limits of the number named by `of`, at the required probability `share` of quiet running.

    over: name of the number that takes each of `values`; None for one limit. given: the gear's other numbers.
    between: the range in which a limit is searched; None for the default range.
    """
    search: dict[str, Any] = {"between": between, "count": count, "seed": seed, "budget": budget}
    if over is None:
        return [design_limit(given, of, share, **search)]
    return design_limits(given, of, over, values or (), share, **search)


def _limit_document(at: float | None, found: Limit) -> LimitDocument:
    return LimitDocument(at=at, **{name: finite_or_none(value) for name, value in found._asdict().items()})
