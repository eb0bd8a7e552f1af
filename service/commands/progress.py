"""Show the progress of a survey, as a bar on a terminal or as plain lines."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.text import Text

PLAIN_SECONDS = 10.0  # least number of seconds between two printed lines


class ProgressReporter(Protocol):
    """A display of the progress of a run: the number of computed cells, and the time left.

    The time left is the run's own estimate. If the run gives none, it follows from the speed so far.
    """

    def __enter__(self) -> Self:
        """Begin the display."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the display."""

    def show_cells_done(self, cells_done: int) -> None:
        """Show the number of computed cells."""

    def show_time_left(self, seconds: float) -> None:
        """Show the run's estimate of the time left."""


class _CompilationHandler(logging.Handler):
    """Log handler that announces the compilation of kernels once, and then prints its progress."""

    def emit(self, record: logging.LogRecord) -> None:
        console = Console(stderr=True)
        if self.level == logging.INFO:
            self.setLevel(logging.INFO - 1)
            console.print("Compiling kernels, once on this machine: this takes up to a minute …")
        console.print(f"… {record.getMessage()}", highlight=False)


@contextmanager
def print_compilation_messages() -> Iterator[None]:
    """Print messages about the compilation of kernels to stderr during this context."""
    log, told = logging.getLogger("rattle.numerics.compile"), _CompilationHandler(logging.INFO)
    level = log.level
    log.setLevel(logging.INFO)
    log.addHandler(told)
    try:
        yield
    finally:
        log.removeHandler(told)
        log.setLevel(level)


def create_reporter(cells: int, cells_done: int = 0, what: str = "cells") -> ProgressReporter:
    """Return a reporter: it draws a progress bar if stderr is a terminal, and otherwise prints a line at intervals.

    cells: the number of all cells. cells_done: the number of cells that were computed before. what: the counted
    objects as a plural, such as "gears".

    Returns
    -------
    ProgressReporter
        A context manager.
    """
    console = Console(stderr=True)
    return (_BarReporter if console.is_terminal else _LineReporter)(console, cells, cells_done, what)


class _CellRateColumn(ProgressColumn):
    """A column of a progress bar with the number of cells per second."""

    def __init__(self, what: str) -> None:
        super().__init__()
        self._what = what

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.0f} {self._what}/s", style="progress.data.speed")


class _TimeLeftColumn(TimeRemainingColumn):
    """A progress bar's column with the time left: the run's own estimate, or else an estimate from the speed so far."""

    def render(self, task: Task) -> Text:
        if task.finished or (ends := task.fields.get("ends")) is None:
            return super().render(task)
        minutes, seconds = divmod(max(int(ends - time.monotonic()), 0), 60)
        hours, minutes = divmod(minutes, 60)
        return Text(f"{hours:d}:{minutes:02d}:{seconds:02d}", style="progress.remaining")


class _BarReporter:
    def __init__(self, console: Console, cells: int, cells_done: int, what: str) -> None:
        self._progress = Progress(
            TextColumn(f"{{task.completed:.0f}} of {{task.total:.0f}} {what}"),
            BarColumn(),
            TaskProgressColumn(),
            _CellRateColumn(what),
            _TimeLeftColumn(),
            console=console,
            speed_estimate_period=60.0,
        )
        self._task = self._progress.add_task("", total=cells, completed=cells_done)

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def show_cells_done(self, cells_done: int) -> None:
        self._progress.update(self._task, completed=cells_done)

    def show_time_left(self, seconds: float) -> None:
        self._progress.update(self._task, ends=time.monotonic() + seconds)


class _LineReporter:
    def __init__(self, console: Console, cells: int, cells_done: int, what: str) -> None:
        self._console = console
        self._cells = cells
        self._what = what
        self._start = cells_done
        self._began = self._shown = time.monotonic()
        self._ends: float | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def show_cells_done(self, cells_done: int) -> None:
        now = time.monotonic()
        if cells_done < self._cells and now - self._shown < PLAIN_SECONDS:
            return
        self._shown = now
        speed = (cells_done - self._start) / max(now - self._began, 1e-9)
        left = (self._cells - cells_done) / speed if speed else float("inf")
        if self._ends is not None:
            left = max(self._ends - now, 0.0)
        self._console.print(
            f"{cells_done} of {self._cells} {self._what}, {speed:.0f} {self._what}/s, {left:.0f} s left",
            highlight=False,
        )

    def show_time_left(self, seconds: float) -> None:
        self._ends = time.monotonic() + seconds
