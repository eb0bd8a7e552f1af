"""Check a request for a survey or a population against the limits of the service."""

from __future__ import annotations

from gear_rattle.service.errors import LimitError
from gear_rattle.service.settings import Settings
from gear_rattle.workers import AnyRequest, PopulationRequest
from gear_rattle.workers.certificates import require_proof_extra
from rattle import MissingExtraError


def require_within_service_limits(request: AnyRequest, settings: Settings) -> None:
    """Refuse a request that exceeds the limits of this service, or requests proofs that the service cannot make.

    The check takes no time, however large the survey is.

    Raises
    ------
    LimitError
        A limit is exceeded, or proofs cannot be made; the error names the field and the limit.
    """
    if isinstance(request, PopulationRequest):
        _check_population(request, settings)
        return
    count = request.initial_conditions.count
    tile_cells = request.tile_shape[0] * request.tile_shape[1]
    _require_at_most("initial_conditions.count", "initial conditions per cell", count, settings.max_count)
    _require_at_most("delta.num", "cells", request.n_cells, settings.max_cells)
    samples = request.samples_per_cell
    each = f"cells times {samples}"
    field = "initial_conditions.count" if samples == count else "quantities"
    _require_at_most(field, f"samples ({each})", request.n_cells * samples, settings.max_samples)
    _require_at_most("tile", "tiles", request.n_tiles, settings.max_tiles)
    _require_at_most("tile", f"samples per tile ({each})", tile_cells * samples, settings.max_tile_samples)
    if request.certify:
        _require_able_to_prove(settings)


def _require_able_to_prove(settings: Settings) -> None:
    if settings.store:
        raise LimitError(
            "body.certify",
            "This service keeps its stores in a bucket, where it cannot make certificates. Leave out certify, and "
            "prove the survey afterwards: rattle certify URL --out PATH.",
        )
    try:
        require_proof_extra()
    except MissingExtraError as error:
        raise LimitError("body.certify", f"This service cannot make certificates. {error}") from error


def _check_population(request: PopulationRequest, settings: Settings) -> None:
    _require_at_most("count", "initial conditions per gear", request.count, settings.max_count)
    _require_at_most("gears", "gears (with those of the pairs)", request.n_cells, settings.max_cells)
    _require_at_most("count", "samples (with those of the judged gears)", request.samples, settings.max_samples)
    _require_at_most("tile", "tiles", request.n_tiles, settings.max_tiles)
    # Every tile is taken to have the mean number of samples per gear. Judged gears need more samples than other gears,
    # but they are spread evenly over all tiles.
    each = -(-request.samples // request.n_cells)
    _require_at_most("tile", "samples per tile", request.tile_shape[0] * each, settings.max_tile_samples)


def _require_at_most(field: str, what: str, value: int, limit: int) -> None:
    if value > limit:
        message = (
            f"{value:,} {what} exceed the limit of this service, {limit:,}. Request fewer, or use the command rattle "
            "run or rattle tolerance."
        )
        raise LimitError(f"body.{field}", message)
