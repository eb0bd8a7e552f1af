"""What a survey must hold."""

import numpy as np
import pytest
from service_processes import serial_run


@pytest.fixture(scope="module")
def expected(request: pytest.FixtureRequest) -> dict[str, np.ndarray]:
    """Every per-cell variable of the module's REQUEST, computed here."""
    return serial_run(request.module.REQUEST)
