"""gear-rattle as other people's code imports it, beside the library `rattle`.

`run_survey` makes a survey and opens it, `open_survey` opens one that is there, `open_family` a family of its
attractors, and `Client` talks to a service. A survey that is opened can draw itself, `survey.rattle.plot("region")`.
What surveys raise is a `SurveyError`, what a client raises a `ServiceError`; both are `rattle.RattleError`s. In
an installed wheel the packages `workers` and `service` stand in here (setup.py): in the checkout they stand beside it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rattle import __version__
    from service.client import Client, Job
    from service.errors import ResponseError, ServiceError, WaitTimeoutError
    from workers import SurveyRequest, open_family, open_survey, run_survey
    from workers.errors import ClusterLostError, DamageError, StoppedError, StorageError, SurveyError
    from workers.storage.complex import split_complex

_PLACES = {
    "Client": "service.client",
    "ClusterLostError": "workers.errors",
    "DamageError": "workers.errors",
    "Job": "service.client",
    "ResponseError": "service.errors",
    "ServiceError": "service.errors",
    "StoppedError": "workers.errors",
    "StorageError": "workers.errors",
    "SurveyError": "workers.errors",
    "SurveyRequest": "workers.survey.request",
    "WaitTimeoutError": "service.errors",
    "__version__": "rattle",
    "open_family": "workers.families.one",
    "open_survey": "workers.storage.store",
    "run_survey": "workers.run",
    "split_complex": "workers.storage.complex",
}

_ACCESSOR = "workers.pictures.accessor"  # registers `survey.rattle` with xarray
_SURVEYS = ("Client", "open_survey", "run_survey")  # what gives surveys to people

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
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name in _SURVEYS:
        import_module(_ACCESSOR)
    return getattr(import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return __all__
