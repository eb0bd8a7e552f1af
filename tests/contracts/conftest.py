"""Fixtures of the tests in this folder."""

from collections.abc import Iterator
from functools import cache
from typing import Any

import pytest
import zarr
from fastapi.routing import APIRoute, _EffectiveRouteContext
from waiting import HANG
from zarr.storage import MemoryStore

import gear_rattle.workers.storage.store
import gear_rattle.workers.survey.template
from gear_rattle.service.database import engine, transactions
from gear_rattle.workers import SurveyRequest


@pytest.fixture(autouse=True, scope="session")
def _databases_are_waited_for() -> Iterator[None]:
    """However long the writers before take."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (engine, transactions):
            patch.setattr(module, "BUSY_SECONDS", int(HANG))
        yield


@pytest.fixture(autouse=True, scope="session")
def _routes_are_made_once() -> Iterator[None]:
    """Make the routes once, not for each of two hundred applications, which takes a tenth of a second each."""
    make, made = _EffectiveRouteContext.from_api_route, dict[int, _EffectiveRouteContext]()

    def route(*, original_route: APIRoute, **options: Any) -> _EffectiveRouteContext:
        if id(original_route) not in made:  # which lives as long as what is made of it
            made[id(original_route)] = make(original_route=original_route, **options)
        return made[id(original_route)]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_EffectiveRouteContext, "from_api_route", route)
        yield


@pytest.fixture(autouse=True, scope="session")
def _curves_are_traced_once() -> Iterator[None]:
    """Trace the curves of a window once for all templates; their bytes do not change."""
    write, written = gear_rattle.workers.survey.template._write_curves, dict[Any, dict[str, Any]]()

    def curves(root: zarr.Group, request: SurveyRequest) -> None:
        assert isinstance(root.store, MemoryStore)
        key, kept = (root.path, request.gear_model, request.delta, request.epsilon), root.store._store_dict
        if key not in written:
            before = set(kept)
            write(root, request)
            written[key] = {name: content for name, content in kept.items() if name not in before}
        kept.update(written[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gear_rattle.workers.survey.template, "_write_curves", curves)
        yield


@pytest.fixture(scope="module")
def templates_once() -> Iterator[None]:
    """Make the template of a request once for all its stores, since it takes longer than its few cells."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            gear_rattle.workers.storage.store, "template_of", cache(gear_rattle.workers.storage.store.template_of)
        )
        yield
