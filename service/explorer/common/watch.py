"""Controls that call somebody when a viewer uses them, and nobody when the page itself sets them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


class Watch:
    """Over some widgets."""

    def __init__(self) -> None:
        self._is_paused = False

    def on(self, widget: Any, used: Callable[[], None]) -> None:
        """Have somebody called when a viewer has given a widget another value."""
        widget.param.watch(lambda _event: None if self._is_paused else used(), "value")

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Set widgets here."""
        self._is_paused = True
        try:
            yield
        finally:
            self._is_paused = False
