"""Format log records as JSON, by pythonjsonlogger, which is imported only by a service with JSON logs."""

from __future__ import annotations

from typing import Any

from pythonjsonlogger.json import JsonFormatter

from gear_rattle.service.observability.logs import PrintableFormatter, escape_unprintable

#: Fields that may have several lines; `PrintableFormatter` has already made them printable.
TRACEBACKS = ("exc_info", "stack_info")


class JsonLineFormatter(PrintableFormatter, JsonFormatter):
    """Formatter that writes a JSON object for each record. Its strings are printable, even when `jq -r` prints them."""

    def process_log_record(self, log_data: dict[str, Any]) -> dict[str, Any]:
        """Return the fields of a record in printable characters."""
        log_data.pop("color_message", None)  # uvicorn's copy of the message for terminals
        return {
            name: escape_unprintable(value.rstrip()) if isinstance(value, str) and name not in TRACEBACKS else value
            for name, value in log_data.items()
        }
