"""What a survey must hold, and a server for those in buckets."""

from collections.abc import Iterator

import numpy as np
import pytest
from s3_server import S3, s3_server
from service_processes import serial_run


@pytest.fixture(scope="module")
def expected(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    """Every per-cell variable of the module's REQUEST, computed here."""
    return serial_run(request.module.REQUEST)


@pytest.fixture(scope="session")
def storage() -> Iterator[S3]:
    """An S3 server of this session, with an empty bucket at its start."""
    with s3_server() as running:
        yield running
