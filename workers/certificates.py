"""Prove a survey's periodic attractors, and keep their certificates in a store beside the survey's.

The store has the certificates as documents in a file, and variables that follow from this file. Certificates are
appended to the file after each batch of proofs, so that a stopped run can be continued. The next run attempts the
unproved attractors again. Checksums of all files are written at the end.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

import rattle
from gear_rattle.workers.errors import SurveyError, storage_error
from gear_rattle.workers.storage.added import RunForEach
from gear_rattle.workers.storage.integrity import COMPLETED
from gear_rattle.workers.storage.location import CERTIFICATES as BESIDE
from gear_rattle.workers.storage.location import Place as Location
from gear_rattle.workers.storage.location import StoreDirectory, certificates_path, place_of
from gear_rattle.workers.storage.manifest import read_unchecked_attributes
from gear_rattle.workers.storage.store import open_survey
from gear_rattle.workers.survey.manifest import ROOT, digest
from gear_rattle.workers.survey.request import SurveyRequest
from gear_rattle.workers.survey.slices import surveyed_model, third_axis_value
from gear_rattle.workers.survey.values.schema import CELL
from rattle.models import Capability, Model, missing_capability_error

if TYPE_CHECKING:
    import xarray as xr

#: Files with a document in each line: the certificates of proved attractors, and the reasons why others are not proved.
CERTIFICATES, REFUSED = "certificates.jsonl", "refused.jsonl"
#: File with the checksums of all other files. It is written when the proof of every attractor has been attempted.
CHECKSUMS_FILE = "checksums.json"
MEANINGS = ("none", "orbit")  # meanings of the codes 0 and 1 of the variable `attractor_certificate`
ORBIT = MEANINGS.index("orbit")
SLOT_DIMS = ("attractor", *CELL)
AT_ONCE = 32  # number of motions that one task proves
IDENTITY_ATTRIBUTE = "survey_content_hash"  # attribute of a store of certificates that identifies the survey

AttractorPlace = tuple[int, int, int]  # slot of an attractor, row (along ε) and column (along δ) of its cell
#: For each attractor its place, with its certificate as a dictionary or the reason why it has none.
ProofResults = list[tuple[AttractorPlace, dict[str, Any] | str]]


class AttractorClaim(NamedTuple):
    """A periodic attractor whose existence and attraction are to be proved.

    slot_and_cell: the attractor's slot, and the row and the column of its cell. tau, v: a state on the attractor.
    label: (m, n₊, n₋).
    """

    slot_and_cell: AttractorPlace
    model: Model
    delta: float
    epsilon: float
    tau: float
    v: float
    label: tuple[int, int, int]


def claims_of(survey: xr.Dataset) -> list[AttractorClaim]:
    """Return the claims that the periodic attractors of a survey exist and attract, cell by cell.

    Returns
    -------
    list[AttractorClaim]
        One claim for each slot with a periodic attractor.

    Raises
    ------
    SurveyError
        The survey has no attractors or has a third axis, or its model has no proofs.
    """
    if "attractor_kind" not in survey:
        raise SurveyError("the survey has no attractors: compute a survey with --quantity attractors")
    model = surveyed_model(survey)
    if Capability.PROOFS not in model.has:
        raise SurveyError(str(missing_capability_error(Capability.PROOFS, model)))
    names = ("kind", "phase", "velocity", "m", "n_plus", "n_minus")
    kind, tau, v, *label = (survey[f"attractor_{name}"].transpose(*SLOT_DIMS).values for name in names)
    delta, epsilon = survey["delta"].values, survey["epsilon"].values
    found = np.argwhere(np.moveaxis(kind == rattle.KINDS.index("periodic"), 0, -1))
    places = [(int(slot), int(i), int(j)) for i, j, slot in found]
    return [
        AttractorClaim(
            place, model, float(delta[place[2]]), float(epsilon[place[1]]), float(tau[place]), float(v[place]),
            (int(label[0][place]), int(label[1][place]), int(label[2][place])),
        )
        for place in places
    ]  # fmt: skip


def certify_claims(claims: Iterable[AttractorClaim]) -> ProofResults:
    """Try to prove claims. Return the slot and cell of each claim, with the certificate or the reason for failure."""
    found: ProofResults = []
    for claim in claims:
        try:
            orbit = claim.model.gear(claim.delta, claim.epsilon).orbit(claim.tau, claim.v, claim.label[1])
            certificate = rattle.certify(orbit)
        except rattle.MissingExtraError:
            raise
        except rattle.RattleError as error:
            found.append((claim.slot_and_cell, str(error)))
            continue
        if certificate.label != claim.label:
            found.append(
                (claim.slot_and_cell, f"the motion of this state is a P{certificate.label}, not a P{claim.label}")
            )
        elif certificate.verdict != "attracting":
            found.append((claim.slot_and_cell, f"the motion is {certificate.verdict}"))
        else:
            found.append((claim.slot_and_cell, certificate.document()))
    return found


def prove_in_this_process(parts: Sequence[list[AttractorClaim]]) -> list[ProofResults]:
    """Prove groups of attractors in this process. Return the results of `certify_claims` for each group."""
    return [certify_claims(part) for part in parts]


def certify_survey(
    survey: xr.Dataset,
    out: Path,
    prove: Callable[[Sequence[list[AttractorClaim]]], list[ProofResults]] = prove_in_this_process,
    at_once: int = 1,
    on_done: Callable[[int, int], None] = lambda _done, _number: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> xr.Dataset:
    """Prove the periodic attractors of a survey, and write certificates and variables to the store `out`.

    Parameters
    ----------
    survey : xr.Dataset
        A survey, opened with `open_survey`.
    prove : Callable[[Sequence[list[AttractorClaim]]], list[ProofResults]]
        Function that calls `certify_claims` for each list of attractors, here or on a cluster, and returns the results
        in the same order. Its errors are passed on.
    at_once : int
        Number of lists in a call of `prove`; their results are stored together.
    on_done : Callable[[int, int], None]
        Called with the number of attractors whose proof was attempted, in this run or earlier runs, and the number of
        all attractors.
    should_stop : Callable[[], bool]
        Called after each call of `prove`. If it returns true, the run ends with the results so far.

    Returns
    -------
    xr.Dataset
        `attractor_certificate` and `attractor_certificate_radius` on (attractor, epsilon, delta).

    Raises
    ------
    SurveyError
        The survey has no attractors or has a third axis, its model has no proofs, or `out` has other contents.
    MissingExtraError
        python-flint is not installed.
    StorageError
        The store cannot be written now.
    """
    claims = claims_of(survey)
    try:
        radii = _open_or_create_certificates(survey, out)
        left = [claim for claim in claims if claim.slot_and_cell not in radii]
        through = len(claims) - len(left)
        on_done(through, len(claims))
        rest = iter(left)
        parts = iter(lambda: list(islice(rest, AT_ONCE)), [])
        with (out / CERTIFICATES).open("a") as proved, (out / REFUSED).open("w") as refused:
            while some := list(islice(parts, at_once)):
                answers = [answer for part in prove(some) for answer in part]
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
                on_done(through, len(claims))
                if should_stop():
                    break
        found = _write_variables(survey, out, radii)
        if through == len(claims):
            ours = [
                path
                for name in (ROOT, CERTIFICATES, REFUSED, *found.variables)
                for path in _files_below(out / str(name))
            ]
            files = _compute_checksums(out, sorted(path.relative_to(out).as_posix() for path in ours))
            (out / CHECKSUMS_FILE).write_text(
                json.dumps({IDENTITY_ATTRIBUTE: _survey_identity(survey), "files": files})
            )
        return found
    except OSError as error:
        refusal = storage_error(f"{out} cannot be written", error)
        raise refusal from error


def _open_or_create_certificates(survey: xr.Dataset, out: Path) -> dict[AttractorPlace, float]:
    """Open a store of certificates, or create it empty. A damaged store is emptied.

    Returns
    -------
    dict[AttractorPlace, float]
        `time_radius` of each stored certificate, by slot and by the cell's indices along ε and δ: the half-width of the
        intervals of impact times in which the motion is unique.

    Raises
    ------
    OSError
        The store cannot be read or written.
    SurveyError
        The directory has other contents.
    """
    import xarray as xr  # imported here, because it takes half a second to load

    identity, files = _read_checksums_file(out)
    is_damaged = identity == _survey_identity(survey) and files != _compute_checksums(out, files)
    if is_damaged:  # it is not known which documents are damaged, so all attractors are proved again
        for key in files:
            (out / key).unlink(missing_ok=True)
    if is_damaged or not out.exists() or not any(out.iterdir()):
        out.mkdir(parents=True, exist_ok=True)
        _write_variables(survey, out, {})
    try:
        with xr.open_zarr(out, chunks=None) as before:
            known = before.attrs.get(IDENTITY_ATTRIBUTE)
    except (FileNotFoundError, ValueError):
        known = None
    if known != _survey_identity(survey):
        raise SurveyError(f"{out} holds no readable certificates of this survey: choose another path")
    (out / CHECKSUMS_FILE).unlink(missing_ok=True)
    certificates = out / CERTIFICATES
    lines = certificates.read_bytes().splitlines(keepends=True) if certificates.exists() else []
    radii: dict[AttractorPlace, float] = {}
    for line in lines:
        try:
            each = json.loads(line)
            place, radius = (each["slot"], *each["cell"]), float(each["time_radius"])
        except (ValueError, KeyError, TypeError):
            break  # a run that was killed may have left its last line incomplete
        if not line.endswith(b"\n"):
            break
        radii[place] = radius
    certificates.write_bytes(b"".join(lines[: len(radii)]))
    return radii


def _survey_identity(survey: xr.Dataset) -> str:
    """Return the text that names the survey (or slice) of a store of certificates: content hash, third-axis value."""
    third = (f" {name}={value!r}" for name, value in third_axis_value(survey).items())
    return "".join([survey.attrs["content_hash"], *third])


def lacks_certificates(request: SurveyRequest, where: str | Path | Location) -> bool:
    """Return whether a completed survey requests certificates that are missing or damaged."""
    if not request.certify:
        return False
    out = certificates_path(where)
    known, files = _read_checksums_file(out)
    return known != request.content_hash() or files != _compute_checksums(out, files)


def write_certificates_of_survey(
    request: SurveyRequest,
    where: str | Path | Location,
    each: RunForEach,
    at_once: int,
    on_done: Callable[[int, int], None],
    should_stop: Callable[[], bool],
) -> None:
    """Prove the periodic attractors of a survey with `certify_survey`, and store the certificates beside the survey.

    each: a function that runs a task for each of several items, such as `run_in_this_process`.
    at_once, on_done, should_stop: as in `certify_survey`.
    """

    def prove(parts: Sequence[list[AttractorClaim]]) -> list[ProofResults]:
        return each(_certify_claims_in_task, request, str(where), [(part,) for part in parts])

    with open_survey(where) as survey:
        certify_survey(survey, certificates_path(where), prove, at_once, on_done, should_stop)


def _certify_claims_in_task(_request: SurveyRequest, _path: str, claims: list[AttractorClaim]) -> ProofResults:
    return certify_claims(claims)


def require_proof_extra() -> None:
    """Raise MissingExtraError if the extra packages for proofs are not installed."""
    import rattle.proof.balls  # noqa: F401 - raises MissingExtraError


def require_certifiable(request: object, where: str | Path | Location) -> None:
    """Raise an error if a request asks for certificates that cannot be made here.

    Raises
    ------
    SurveyError
        The survey is to be stored in a bucket.
    MissingExtraError
        The extra packages for proofs are not installed.
    """
    if isinstance(request, SurveyRequest) and request.certify:
        certificates_path(where)
        require_proof_extra()


@dataclass(frozen=True)
class CertificatesIntegrity:
    """Result of checking every file of a store of certificates."""

    path: Path
    survey: str  # content hash and slice of the survey; empty if the store has lost this information
    files: int  # how many files were compared with their checksums
    damaged: tuple[str, ...]  # keys of lost or damaged files
    complete: bool  # False if the store has no checksums yet, because the run has not ended


def is_certificate_store(where: str | Path | Location) -> bool:
    """Return whether a directory is a store of certificates, damaged or not."""
    place = place_of(where)
    return isinstance(place, StoreDirectory) and (
        IDENTITY_ATTRIBUTE in read_unchecked_attributes(place)
        or any((place.path / name).is_file() for name in (CHECKSUMS_FILE, CERTIFICATES))
    )


def examine_certificates(out: Path, ended: bool = False) -> CertificatesIntegrity:
    """Compare every file of a store of certificates with its checksum.

    Parameters
    ----------
    out : pathlib.Path
        The store.
    ended : bool
        True if the run that proves the attractors has ended. A missing file of checksums then counts as lost,
        because a run writes this file at its end.

    Returns
    -------
    CertificatesIntegrity
        Number of compared files, and lost or damaged files.
    """
    known, files = _read_checksums_file(out)
    complete = ended or (out / CHECKSUMS_FILE).exists()
    if not known:
        known = str(read_unchecked_attributes(StoreDirectory(out)).get(IDENTITY_ATTRIBUTE, ""))
        return CertificatesIntegrity(out, known, 0, (CHECKSUMS_FILE,) if complete else (), complete)
    found = _compute_checksums(out, files)
    lost = tuple(key for key, of in files.items() if found.get(key) != of)
    return CertificatesIntegrity(out, known, len(files), lost, complete)


def examine_certificates_beside_survey(where: str | Path | Location) -> list[CertificatesIntegrity]:
    """Check each store of certificates beside a survey, also those of its slices; [] for a survey in a bucket.

    A store that is missing although the completed survey requests certificates is in the list too.

    Returns
    -------
    list[CertificatesIntegrity]
        The result for each store, in the order of their paths.
    """
    place = place_of(where)
    if not isinstance(place, StoreDirectory):
        return []
    attributes = read_unchecked_attributes(place)
    try:
        certify = json.loads(attributes["request"])["certify"] is True
    except (KeyError, TypeError, ValueError):
        certify = False
    due = certificates_path(place)
    stem = due.name.removesuffix(BESIDE)
    ours = re.compile(rf"{re.escape(stem)}(\.slice\d+)?{re.escape(BESIDE)}")
    there = {each for each in due.parent.iterdir() if ours.fullmatch(each.name)}
    is_due = certify and COMPLETED in attributes
    return [examine_certificates(each, is_due and each == due) for each in sorted(there | ({due} if is_due else set()))]


def _read_checksums_file(out: Path) -> tuple[str, dict[str, str]]:
    """Return the survey's identity and the checksums from the file CHECKSUMS_FILE; empty ones if it cannot be read."""
    try:
        content = json.loads((out / CHECKSUMS_FILE).read_bytes())
        return str(content[IDENTITY_ATTRIBUTE]), dict(content["files"])
    except (OSError, ValueError, KeyError, TypeError):
        return "", {}


def _files_below(path: Path) -> list[Path]:
    """Return the files below a path, or the path itself if it is a file."""
    return [path] if path.is_file() else [each for each in path.rglob("*") if each.is_file()]


def _compute_checksums(out: Path, files: Iterable[str]) -> dict[str, str]:
    """Return {key: checksum} of files. Files that cannot be read are left out."""
    found: dict[str, str] = {}
    for key in files:
        with suppress(OSError):
            found[key] = digest((out / key).read_bytes())
    return found


def _write_variables(survey: xr.Dataset, out: Path, radii: dict[AttractorPlace, float]) -> xr.Dataset:
    """Write the variables that follow from the certificates, and return them as a dataset.

    radii: `time_radius` of the certificate of each proved attractor, by its place (slot, row and column of its cell).

    Returns
    -------
    xr.Dataset
        `attractor_certificate`, and `attractor_certificate_radius`, which is NaN where nothing is proved.
    """
    import xarray as xr
    from zarr.errors import ZarrUserWarning

    shape = tuple(survey.sizes[dim] for dim in SLOT_DIMS)
    proved, radius = np.zeros(shape, "int8"), np.full(shape, np.nan)
    for place, each in radii.items():
        proved[place], radius[place] = ORBIT, each
    described = {"units": "1", "references": "docs/proofs.md"}
    flags = {"flag_values": np.arange(len(MEANINGS), dtype="int8"), "flag_meanings": " ".join(MEANINGS)}
    what = {"long_name": "what is proved: none is nothing, orbit that it exists and attracts"} | described | flags
    width = {"long_name": "half-width in time of the box in which the motion is unique"} | described
    variables = {
        "attractor_certificate": (SLOT_DIMS, proved, what),
        "attractor_certificate_radius": (SLOT_DIMS, radius, width),
    }
    coordinates = {name: survey[name].variable for name in SLOT_DIMS}
    attributes = {
        "Conventions": "CF-1.11",
        "title": "Certificates of the periodic attractors of a survey",
        IDENTITY_ATTRIBUTE: _survey_identity(survey),
        "documents": CERTIFICATES,
    }
    found = xr.Dataset(variables, coordinates, attributes)
    with warnings.catch_warnings():
        # zarr warns that other libraries may ignore consolidated metadata, which is harmless.
        warnings.simplefilter("ignore", ZarrUserWarning)
        found.to_zarr(out, mode="a", zarr_format=3)
    return found
