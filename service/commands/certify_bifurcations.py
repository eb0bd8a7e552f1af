"""``rattle certify`` for bifurcations: prove points of a survey's curves, and the points where curves meet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from rattle.proof.bifurcations.certificate import BifurcationCertificate


def codimension_two_certificates(beta: str) -> Iterator[BifurcationCertificate]:
    """Yield the certificates of the codimension-two points COD20 to COD23 at a half-backlash."""
    from rattle.proof.bifurcations.prove import certify_codimension_two

    yield from certify_codimension_two(beta)


def curve_point_certificates(store: str, slice_number: int | None) -> Iterator[BifurcationCertificate | str]:
    """Yield the certificate of each point of a survey's curves, or the reason why it is not proved."""
    import rattle
    from gear_rattle.service.results import open_results
    from gear_rattle.workers.survey.slices import select_slice, slice_group_path, surveyed_model
    from rattle.models import Capability, require_capability
    from rattle.proof.bifurcations.prove import certify_curve_point

    with open_results(store) as whole:
        model = surveyed_model(select_slice(whole, slice_number))
    require_capability(Capability.BIFURCATION_PROOFS, model)
    for name in rattle.curves.CURVES:
        with open_results(store, group=slice_group_path(slice_number, f"curves/{name}")) as curve:
            for delta, epsilon, *motion in _codimension_two_point_rows(curve):
                try:
                    yield certify_curve_point(name, delta, epsilon, model.beta, (motion[0], motion[1]))
                except rattle.NotProvedError as why:
                    yield f"{name} at delta = {delta!r}, epsilon = {epsilon!r}: {why}"


def _codimension_two_point_rows(curve: xr.Dataset) -> Iterator[tuple[float, ...]]:
    names = ("point_delta", "point_epsilon", "phase", "velocity")
    return zip(*(curve[name].values.tolist() for name in names), strict=True)
