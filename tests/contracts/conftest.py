"""What the tests of this folder share."""

from collections.abc import Iterator
from functools import cache

import pytest
from waiting import HANG

import workers.storage.store
from service.database import engine, transactions


@pytest.fixture(autouse=True, scope="session")
def _databases_are_waited_for() -> Iterator[None]:
    """However long the writers before take."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (engine, transactions):
            patch.setattr(module, "BUSY_SECONDS", int(HANG))
        yield


@pytest.fixture(scope="module")
def templates_once() -> Iterator[None]:
    """Of the stores of one request the template is made once: it takes longer than its few cells."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(workers.storage.store, "template_of", cache(workers.storage.store.template_of))
        yield
