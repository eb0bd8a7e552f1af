"""Certificates of a survey's periodic attractors: documents, and variables in a store of their own beside the survey's.

Whatever is found is appended to a file at once, so that a run that was stopped is resumed; from that file the variables
follow. What was not proved is tried again by the next run.
"""

import json
import multiprocessing
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from zarr.errors import ZarrUserWarning

import rattle
from rattle.models import AnyModel
from workers.errors import SurveyError, storage_error
from workers.survey.slices import surveyed_model, value_along
from workers.survey.values.schema import CELL

CERTIFICATES, REFUSED = "certificates.jsonl", "refused.jsonl"  # one document a line, with its cell and slot
MEANINGS = ("none", "orbit")
ORBIT = MEANINGS.index("orbit")
SLOT = ("attractor", *CELL)
AT_ONCE = 32  # motions that a process is given
KNOWN = "survey_content_hash"

Place = tuple[int, int, int]  # slot, cell along ε and along δ


class Claim(NamedTuple):
    """A periodic attractor as a survey has it."""

    place: Place
    model: AnyModel
    delta: float
    epsilon: float
    tau: float
    v: float
    label: tuple[int, int, int]


def claims_of(survey: xr.Dataset) -> list[Claim]:
    """Return the periodic attractors of a survey, cell by cell. Raises SurveyError if it has none, or a third axis."""
    if "attractor_kind" not in survey:
        raise SurveyError("the survey has no attractors: ask for the group attractors")
    model = surveyed_model(survey)
    names = ("kind", "phase", "velocity", "m", "n_plus", "n_minus")
    kind, tau, v, *label = (survey[f"attractor_{name}"].transpose(*SLOT).values for name in names)
    delta, epsilon = survey["delta"].values, survey["epsilon"].values
    found = np.argwhere(np.moveaxis(kind == rattle.KINDS.index("periodic"), 0, -1))
    places = [(int(slot), int(i), int(j)) for i, j, slot in found]
    return [
        Claim(
            place, model, float(delta[place[2]]), float(epsilon[place[1]]), float(tau[place]), float(v[place]),
            (int(label[0][place]), int(label[1][place]), int(label[2][place])),
        )
        for place in places
    ]  # fmt: skip


def certified(claims: Iterable[Claim]) -> list[tuple[Place, dict[str, Any] | str]]:
    """Return of each attractor its certificate as a document, or why it is not proved."""
    found: list[tuple[Place, dict[str, Any] | str]] = []
    for claim in claims:
        try:
            orbit = claim.model.gear(claim.delta, claim.epsilon).orbit(claim.tau, claim.v, claim.label[1])
            certificate = rattle.certify(orbit, kappa=claim.model.stiffness)
        except rattle.MissingExtraError:
            raise
        except rattle.RattleError as error:
            found.append((claim.place, str(error)))
            continue
        if certificate.label != claim.label:
            found.append((claim.place, f"the motion there is a P{certificate.label}, not a P{claim.label}"))
        elif certificate.verdict != "attracting":
            found.append((claim.place, f"the motion is {certificate.verdict}"))
        else:
            found.append((claim.place, certificate.document()))
    return found


def certify_survey(
    survey: xr.Dataset,
    out: Path,
    processes: int = 1,
    on_done: Callable[[int], None] = lambda _: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> xr.Dataset:
    """Prove the periodic attractors of a survey, and write certificates and variables to the store `out`.

    Args:
        survey: as `open_survey` gives it.
        processes: that prove; with 1 it is this one.
        on_done: told the number of attractors that are through, those of earlier runs included.
        should_stop: asked after each few attractors; what is through by then is kept.

    Returns the variables: `attractor_certificate` and `attractor_certificate_radius` on (attractor, epsilon, delta).

    Raises:
        StorageError: it cannot be written now.
        SurveyError: the survey has no attractors, or `out` holds something else.
        MissingExtraError: python-flint is not installed.
    """
    claims = claims_of(survey)
    try:
        radii = _begun(survey, out)
        left = [claim for claim in claims if claim.place not in radii]
        through = len(claims) - len(left)
        on_done(through)
        with (out / CERTIFICATES).open("a") as proved, (out / REFUSED).open("w") as refused:
            for answers in _answers(left, processes):
                for place, answer in answers:
                    slot, *cell = place
                    where = {"cell": cell, "slot": slot}
                    if isinstance(answer, str):
                        refused.write(json.dumps({**where, "refused": answer}, ensure_ascii=False) + "\n")
                    else:
                        proved.write(json.dumps({**where, **answer}) + "\n")
                        radii[place] = float(answer["time_radius"])
                proved.flush()
                through += len(answers)
                on_done(through)
                if should_stop():
                    break
        return _written(survey, out, radii)
    except OSError as error:
        raise storage_error(f"{out} cannot be written", error) from error


def _answers(claims: list[Claim], processes: int) -> Iterator[list[tuple[Place, dict[str, Any] | str]]]:
    """Yield the answers of a few attractors at a time, in order."""
    rest = iter(claims)
    parts = iter(lambda: list(islice(rest, AT_ONCE)), [])
    if processes == 1:
        yield from map(certified, parts)
        return
    pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"))
    try:
        yield from pool.map(certified, parts)
    finally:
        pool.shutdown(cancel_futures=True)


def _begun(survey: xr.Dataset, out: Path) -> dict[Place, float]:
    """Create the store, or read the radii that an earlier run found. Raises OSError, and SurveyError."""
    if not out.exists() or not any(out.iterdir()):
        out.mkdir(parents=True, exist_ok=True)
        _written(survey, out, {})
    try:
        with xr.open_zarr(out, chunks=None) as before:
            known = before.attrs.get(KNOWN)
    except (FileNotFoundError, ValueError):
        known = None
    if known != _known(survey):
        raise SurveyError(f"{out} holds other things than the certificates of this survey: choose another path")
    certificates = out / CERTIFICATES
    whole = certificates.read_bytes().rpartition(b"\n")[0] if certificates.exists() else b""
    certificates.write_bytes(whole + b"\n" if whole else b"")  # without the line that a killed run was at
    documents = [json.loads(line) for line in whole.splitlines()]
    return {(each["slot"], *each["cell"]): float(each["time_radius"]) for each in documents}


def _known(survey: xr.Dataset) -> str:
    """What a store of certificates knows its survey by, or the slice of it."""
    third = (f" {name}={value!r}" for name, value in value_along(survey).items())
    return "".join([survey.attrs["content_hash"], *third])


def _written(survey: xr.Dataset, out: Path, radii: dict[Place, float]) -> xr.Dataset:
    """Write the variables that follow from the certificates, and return them."""
    shape = tuple(survey.sizes[dim] for dim in SLOT)
    proved, radius = np.zeros(shape, "int8"), np.full(shape, np.nan)
    for place, each in radii.items():
        proved[place], radius[place] = ORBIT, each
    described = {"units": "1", "references": "docs/proofs.md"}
    flags = {"flag_values": np.arange(len(MEANINGS), dtype="int8"), "flag_meanings": " ".join(MEANINGS)}
    what = {"long_name": "what is proved: none is nothing, orbit that it exists and attracts"} | described | flags
    width = {"long_name": "half-width in time of the box in which the motion is unique"} | described
    variables = {
        "attractor_certificate": (SLOT, proved, what),
        "attractor_certificate_radius": (SLOT, radius, width),
    }
    coordinates = {name: survey[name].variable for name in SLOT}
    attributes = {
        "Conventions": "CF-1.11",
        "title": "Certificates of the periodic attractors of a survey",
        KNOWN: _known(survey),
        "documents": CERTIFICATES,
    }
    found = xr.Dataset(variables, coordinates, attributes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ZarrUserWarning)  # that other libraries may not read consolidated metadata
        found.to_zarr(out, mode="a", zarr_format=3)
    return found
