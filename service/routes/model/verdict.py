"""Answer whether a machine rattles, in one line."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Literal

from fastapi import APIRouter, Body, Depends, Query
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from gear_rattle.service.operations.points import finite_or_none
from gear_rattle.service.operations.processes import compute_in_process
from gear_rattle.service.routes.model.machine import (
    MachineDocument,
    MachineQuery,
    MeasuredMachineQuery,
    machine_document,
)
from gear_rattle.service.routes.model.points import SampleCount, SampleSeed, require_few_samples
from gear_rattle.service.state import ApplicationState, FrontState
from gear_rattle.service.web.conditional import NOT_MODIFIED, set_query_etag
from gear_rattle.service.web.problems import declare_problems
from rattle import Machine, RattleError, TransmissionError, read_transmission_error
from rattle.models import model_of_gear
from rattle.parameters import HIGHEST_ORDER

router = APIRouter(prefix="/v1", tags=["points"])

CSV = "text/csv"
ORDERS = 40
EXAMPLE = "angle_deg,error_um\n" + "".join(f"{4 * i},{15 * math.cos(math.radians(4 * i)):.2f}\n" for i in range(90))


class MeasuredDocument(BaseModel):
    """A measured transmission error as a sum of harmonics."""

    harmonics: list[tuple[int, float, float]] = Field(description="order of the revolution, amplitude in m, phase")
    left_out: float = Field(description="root mean square of the part of the curve that these orders leave out, m")
    peak_to_peak: float = Field(description="peak-to-peak value of the measured curve, m")
    points: int
    revolutions: int


class VerdictDocument(BaseModel):
    """The verdict on a machine: whether it rattles, from which share of starts, and which least knock sets it off."""

    kind: Literal["quiet", "quiet_unless_knocked", "rattles_sometimes", "always_rattles"]
    share: float = Field(description="share of the starts that end in rattling")
    low: float = Field(description="lower end of its 95 % interval; undecided starts may count as either")
    high: float
    knock: float | None = Field(
        description="least speed of a knock that makes teeth in contact rattle, m/s along the line of action; null: no "
        "knock up to `hardest` does"
    )
    hardest: float | None = Field(description="speed of the hardest knock that was tried, m/s")
    undecided: float = Field(description="share of the starts whose end stayed undecided")
    text: str = Field(description="the verdict in one line")
    machine: MachineDocument
    measured: MeasuredDocument | None = Field(description="the measured transmission error; null without one")


@router.get(
    "/verdict",
    summary="Whether a machine in SI units rattles, in one answer",
    dependencies=[Depends(set_query_etag)],
    responses={**NOT_MODIFIED, **declare_problems(422)},
)
async def verdict(
    front: FrontState, machine: MachineQuery, count: SampleCount = 256, seed: SampleSeed = 0
) -> VerdictDocument:
    """Return the verdict on a machine: quiet, quiet unless knocked, rattles from some starts, or always rattles."""
    return await _verdict_document(front, machine, None, count, seed)


@router.post(
    "/verdict",
    summary="Whether a machine with a measured transmission error rattles",
    responses=declare_problems(413, 422),
)
async def verdict_of_measured(
    front: FrontState,
    machine: MeasuredMachineQuery,
    curve: Annotated[
        str,
        Body(
            media_type=CSV,
            description="A table with a header, over whole revolutions of the first gear: a column angle_deg, "
            "angle_rad or angle_rev, and one error_um, error_mm or error_m.",
            examples=[EXAMPLE],
        ),
    ],
    orders: Annotated[int, Query(ge=1, le=HIGHEST_ORDER, description="highest order of the curve")] = ORDERS,
    count: SampleCount = 256,
    seed: SampleSeed = 0,
) -> VerdictDocument:
    """Return the verdict on a machine whose transmission error is measured and sent as a CSV table.

    The table contains the effect of the eccentricity, which is therefore no parameter. `machine` in the answer has the
    parameter point, restitution and harmonics of this machine, in the form that the queries of other routes accept.
    """
    measured = await run_in_threadpool(_read_transmission_error, curve, orders)
    return await _verdict_document(front, replace(machine, errors=measured.harmonics), measured, count, seed)


def _read_transmission_error(text: str, orders: int) -> TransmissionError:
    """Read a transmission error from the CSV text of a request. orders: the highest order of its harmonics.

    If the text is wrong, raise RattleError; its message calls the text "the body".
    """
    with TemporaryDirectory() as directory:
        table = Path(directory, "curve.csv")
        table.write_text(text, encoding="utf-8")
        try:
            return read_transmission_error(table, orders)
        except RattleError as error:
            raise type(error)(f"{error}".replace(f"{table}", "the body")) from None


async def _verdict_document(
    front: ApplicationState, machine: Machine, measured: TransmissionError | None, count: int, seed: int
) -> VerdictDocument:
    require_few_samples(front, count)
    found = await compute_in_process(
        front,
        machine.verdict,
        count,
        seed,
        model=model_of_gear(machine.gear).name,
        what="The verdict",
        advice="Request fewer initial conditions (count).",
    )
    return VerdictDocument(
        **found._asdict() | {"knock": finite_or_none(found.knock), "hardest": finite_or_none(found.hardest)},
        text=str(found),
        machine=machine_document(machine),
        measured=None
        if measured is None
        else MeasuredDocument(
            harmonics=list(measured.harmonics),
            left_out=measured.left_out,
            peak_to_peak=measured.peak_to_peak,
            points=measured.points,
            revolutions=measured.revolutions,
        ),
    )
