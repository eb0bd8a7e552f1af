"""The errors of the service and its client; :mod:`gear_rattle.service.web.problems` maps them to HTTP statuses.

The public package `gear_rattle` exports the errors that the client raises.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rattle import RattleError


class ServiceError(RattleError):
    """Base of all errors of the service, the commands and the client."""

    __module__ = "gear_rattle"
    code = "service_error"


class UnknownSurveyError(ServiceError):
    """No survey, or no population, has this id. kind: "survey" or "population"."""

    code = "unknown_survey"

    def __init__(self, survey_id: str, kind: str = "survey") -> None:
        super().__init__(f"There is no {kind} {survey_id!r}. GET /v1/{kind}s lists the {kind}s of this service.")


class UnknownKeyError(ServiceError):
    """No API key has this id."""

    code = "unknown_key"

    def __init__(self, key_id: str) -> None:
        super().__init__(f"There is no key {key_id!r}. `rattle key list` lists the keys.")


class UnauthorizedError(ServiceError):
    """The service requires a key, but the request has no key, an unknown or revoked key, or an ended session."""

    code = "unauthorized"


class ForbiddenError(ServiceError):
    """The request is not allowed: its key lacks a permission, or it names another host or comes from another site."""

    code = "forbidden"


class QuotaError(ForbiddenError):
    """The surveys and populations of an API key would, with this request, have more cells than the key's quota."""

    code = "quota_exceeded"


class WaitTimeoutError(ServiceError, TimeoutError):
    """A survey or population has not ended in the given time."""

    __module__ = "gear_rattle"
    code = "wait_timeout"


class MissingPartError(ServiceError):
    """A survey or population exists, but its requested part does not, or the requested format cannot be written."""

    code = "not_in_survey"


class NoKeysError(ServiceError):
    """The service does not start, because keys are required but none exists."""

    code = "unsafe_access"


class ListenAddressError(ServiceError):
    """The service cannot listen at the address and port of its settings."""

    code = "address_unavailable"


class ConflictError(ServiceError):
    """The request contradicts the state of a survey or population, or an earlier request with its idempotency key."""

    code = "conflict"


class LimitError(ServiceError):
    """The service does not accept a value of the request. field: location of the value, such as "query.count"."""

    code = "limit_exceeded"

    def __init__(self, field: str, message: str) -> None:
        super().__init__(message)
        self.field = field


class QueueFullError(ServiceError):
    """Too many surveys and populations of the service, or of an API key, are waiting or running."""

    code = "queue_full"


class UnavailableError(ServiceError):
    """The service cannot answer now. The same request may succeed later."""

    code = "unavailable"


class DirectoryMissingError(UnavailableError):
    """The data directory is missing, or another directory is in its place."""

    code = "data_directory_away"

    def __init__(self) -> None:
        super().__init__(
            "The data directory of the service is missing: is its disk mounted? The service continues when the "
            "directory is back. Try again later."
        )


class KernelsNotReadyError(UnavailableError):
    """The request needs compiled kernels, and their compilation has not ended."""

    code = "compiling_kernels"

    def __init__(self) -> None:
        super().__init__(
            "Kernels are being compiled, once after the service was installed or updated. Try again in a few seconds; "
            "GET /v1/ready says when the service is ready."
        )


class DataDirectoryError(ServiceError):
    """The data directory or job database cannot be used: missing, foreign, unsupported, locked or not writable."""

    code = "data_directory_unusable"


class ResponseError(ServiceError):
    """A server answered the client with an error.

    Attributes
    ----------
    status
        HTTP status of the answer.
    problem
        The problem document (RFC 9457); empty if the answer has none.
    """

    __module__ = "gear_rattle"
    code = "error_response"

    def __init__(self, status: int, message: str, problem: Mapping[str, Any]) -> None:
        super().__init__(message)
        self.status = status
        self.problem = dict(problem)
