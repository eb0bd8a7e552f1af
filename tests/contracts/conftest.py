"""What the tests of this folder share."""

from collections.abc import Iterator

import pytest
from waiting import HANG

from service.database import engine, transactions


@pytest.fixture(autouse=True, scope="session")
def _databases_are_waited_for() -> Iterator[None]:
    """However long the writers before take."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (engine, transactions):
            patch.setattr(module, "BUSY_SECONDS", int(HANG))
        yield
