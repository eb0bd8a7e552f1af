"""The public package of surveys and services, beside the library `rattle`.

`run_survey` computes a survey and opens it, `open_survey` opens an existing survey, `open_family` opens one family of
its attractors, and `Client` talks to a service. An opened survey draws itself with `survey.rattle.plot("region")`.
Surveys raise `SurveyError`, and clients raise `ServiceError`; both are derived from `rattle.RattleError`. The packages
`workers` and `service` are inside this package; in a checkout they are links to the folders beside it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gear_rattle.service.client import Client, Job
    from gear_rattle.service.errors import ResponseError, ServiceError, WaitTimeoutError
    from gear_rattle.workers import SurveyRequest, open_family, open_survey, run_survey
    from gear_rattle.workers.errors import ClusterLostError, DamageError, StoppedError, StorageError, SurveyError
    from gear_rattle.workers.storage.complex import split_complex
    from rattle import __version__

#: The module that defines each exported name.
_MODULES = {
    "Client": "gear_rattle.service.client",
    "ClusterLostError": "gear_rattle.workers.errors",
    "DamageError": "gear_rattle.workers.errors",
    "Job": "gear_rattle.service.client",
    "ResponseError": "gear_rattle.service.errors",
    "ServiceError": "gear_rattle.service.errors",
    "StoppedError": "gear_rattle.workers.errors",
    "StorageError": "gear_rattle.workers.errors",
    "SurveyError": "gear_rattle.workers.errors",
    "SurveyRequest": "gear_rattle.workers.survey.request",
    "WaitTimeoutError": "gear_rattle.service.errors",
    "__version__": "rattle",
    "open_family": "gear_rattle.workers.families.one",
    "open_survey": "gear_rattle.workers.storage.store",
    "run_survey": "gear_rattle.workers.run",
    "split_complex": "gear_rattle.workers.storage.complex",
}

_ACCESSOR = "gear_rattle.workers.pictures.accessor"  # importing this module registers `survey.rattle` with xarray
#: Exported names with which users get opened surveys, for which `survey.rattle` must be registered.
_NEED_ACCESSOR = ("Client", "open_survey", "run_survey")

__all__ = [
    "Client",
    "ClusterLostError",
    "DamageError",
    "Job",
    "ResponseError",
    "ServiceError",
    "StoppedError",
    "StorageError",
    "SurveyError",
    "SurveyRequest",
    "WaitTimeoutError",
    "__version__",
    "open_family",
    "open_survey",
    "run_survey",
    "split_complex",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in _NEED_ACCESSOR:
        import_module(_ACCESSOR)
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return __all__
