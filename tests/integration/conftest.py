"""The expected values of a survey, and processes that belong to one module."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from service_processes import serial_run


@pytest.fixture(scope="module")
def expected(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    """Every per-cell variable of the module's REQUEST, computed here."""
    return serial_run(request.module.REQUEST)


@pytest.fixture
def short_path() -> Iterator[Path]:
    """For `TMPDIR`, which sockets are below: their names have 107 bytes, of which `tmp_path` may take too many."""
    with TemporaryDirectory() as directory:
        yield Path(directory)
