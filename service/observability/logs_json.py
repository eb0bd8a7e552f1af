"""Lines of JSON, apart from `observability.logs`: only a service that writes them needs the library."""

from __future__ import annotations

from typing import Any

from pythonjsonlogger.json import JsonFormatter

from gear_rattle.service.observability.logs import Printable, printable

#: Have lines, each of them printable already.
TRACEBACKS = ("exc_info", "stack_info")


class Json(Printable, JsonFormatter):
    """An object of JSON; what its strings say is printable too, for whoever reads them by `jq -r`."""

    def process_log_record(self, log_data: dict[str, Any]) -> dict[str, Any]:
        """Return the fields of a record in printable characters."""
        log_data.pop("color_message", None)  # uvicorn's message once more, for terminals
        return {
            name: printable(value.rstrip()) if isinstance(value, str) and name not in TRACEBACKS else value
            for name, value in log_data.items()
        }
