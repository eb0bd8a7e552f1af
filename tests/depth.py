"""How deep the tests look: quick by default, deep with TEST_DEPTH=deep (`make test-deep`), before a release."""

import os
from typing import TypeVar

import pytest

DEEP = os.environ.get("TEST_DEPTH", "quick") == "deep"

Amount = TypeVar("Amount")

#: Marks what is too long for every day, and whose lines and mutations a quick test covers as well.
deep = pytest.mark.deep


def either(quick: Amount, deep: Amount) -> Amount:
    """The amount (examples, samples, grid points) of this depth."""
    return deep if DEEP else quick
