"""Fixtures of the integration tests: the values that a survey must have, and a short temporary directory."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from service_processes import serial_run


@pytest.fixture(scope="module")
def expected(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    """Return every per-cell variable of the module's REQUEST, computed in this process."""
    return serial_run(request.module.REQUEST)


@pytest.fixture
def short_path() -> Iterator[Path]:
    """Yield a directory for `TMPDIR`. The name of a socket in it has at most 107 bytes; `tmp_path` may be too long."""
    with TemporaryDirectory() as directory:
        yield Path(directory)
