"""Format logs as text or JSON lines. Each record names the survey and the request that it belongs to.

Whatever a client sends, a record is one line of printable characters, so that nobody can forge records or send control
characters to a reader's terminal. Only tracebacks have further lines.
"""

from __future__ import annotations

import logging
import re
import traceback
from contextlib import contextmanager
from contextvars import ContextVar
from copy import copy
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import TracebackType


#: The beginning of a frame of a traceback, also in an exception group.
FRAME = re.compile(r'[ |+\-]*File "')

_survey: ContextVar[str | None] = ContextVar("survey", default=None)
current_request: ContextVar[str | None] = ContextVar("request", default=None)

log = logging.getLogger(__name__)


@contextmanager
def add_survey_id_to_logs(survey_id: str) -> Iterator[None]:
    """Add a survey's id to every log record of this thread or task during this context."""
    token = _survey.set(survey_id)
    try:
        yield
    finally:
        _survey.reset(token)


class ContextFilter(logging.Filter):
    """Log filter that adds the ids of the survey and the request to a record."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Add the ids of the survey and the request to a record. Return True, so that every record is logged."""
        for name, variable in (("survey", _survey), ("request", current_request)):
            if not hasattr(record, name) and (value := variable.get()):
                setattr(record, name, value)
        return True


def escape_unprintable(text: str) -> str:
    """Return text in one line. Characters that are not printable become escape sequences of Python."""
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)


class PrintableFormatter(logging.Formatter):
    """Base class of the formatters of text and of JSON. It makes tracebacks printable."""

    def formatException(self, ei: Any) -> str:  # noqa: N802 - the name of logging
        """Return the traceback in printable characters."""
        return "\n".join(_traceback_lines(*ei))

    def formatStack(self, stack_info: str) -> str:  # noqa: N802
        """Return the stack in printable characters."""
        return "\n".join(f"  {escape_unprintable(line)}" for line in stack_info.split("\n"))


def _traceback_lines(
    kind: type[BaseException] | None, error: BaseException | None, frames: TracebackType | None
) -> list[str]:
    """Return the lines of a traceback, indented to distinguish them from records.

    A frame of the traceback may have several lines. The message of an error is one line, because it may quote what a
    client sent.

    Returns
    -------
    list[str]
        Printable lines.
    """
    lines = []
    for part in traceback.format_exception(kind, error, frames):
        text = part.strip("\n")
        lines += text.split("\n") if FRAME.match(text) else [text]
    return [f"  {escape_unprintable(line)}" for line in lines]


class TextFormatter(PrintableFormatter):
    """Formatter of text records: the message, followed by survey, request and duration, if the record has them."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as text. The traceback is formatted here, even if another handler has formatted it."""
        alone = copy(record)
        alone.exc_text = None  # drops the traceback that another formatter has stored here as text
        return super().format(alone)

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802
        """Return the message, followed by survey, request and duration in seconds, as far as the record has them."""
        names = ("survey", "request", "seconds")
        about = "".join(f" {n}={getattr(record, n)}" for n in names if hasattr(record, n))
        return escape_unprintable(super().formatMessage(record).rstrip() + about)


def log_config(form: str) -> dict[str, Any]:
    """Return a configuration for `logging.config.dictConfig` that writes logs to stderr. form: "text" or "json"."""
    fields = "%(asctime)s %(levelname)s %(name)s %(message)s"
    formatter = {"()": TextFormatter, "format": fields}
    if form == "json":
        names = {"asctime": "time", "levelname": "level", "name": "logger"}
        formatter = {
            "()": "gear_rattle.service.observability.logs_json.JsonLineFormatter",
            "format": fields,
            "datefmt": "%Y-%m-%dT%H:%M:%S%z",
            "rename_fields": names,
        }
    return {
        "version": 1,
        "disable_existing_loggers": False,
        "filters": {"context": {"()": ContextFilter}},
        "formatters": {"line": formatter},
        "handlers": {"stderr": {"class": "logging.StreamHandler", "formatter": "line", "filters": ["context"]}},
        "root": {"level": "INFO", "handlers": ["stderr"]},
    }


def format_logs_of_libraries() -> None:
    """Give the log handlers of libraries this project's formatter: dask and Panel install handlers at import."""
    ours = next((each for each in logging.root.handlers if isinstance(each.formatter, PrintableFormatter)), None)
    if ours is None:
        return
    for logger in tuple(logging.root.manager.loggerDict.values()):
        for handler in logger.handlers if isinstance(logger, logging.Logger) else ():
            if type(handler) is logging.StreamHandler and handler.formatter is not ours.formatter:
                handler.setFormatter(ours.formatter)
                handler.addFilter(ContextFilter())
