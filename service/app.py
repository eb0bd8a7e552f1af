"""Assemble the ASGI application from its settings. Its lifespan opens the data directory, database and cluster."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, AbstractContextManager, asynccontextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anyio import CapacityLimiter
from fastapi import Depends, FastAPI
from fastapi_offline import FastAPIOffline
from starlette.concurrency import run_in_threadpool
from starlette.middleware.body_limit import RequestBodyLimitMiddleware
from starlette.middleware.cors import CORSMiddleware
from starlette.responses import RedirectResponse

import rattle
from gear_rattle import workers
from gear_rattle.service.access.middleware import REFERENCE_ASSETS, AccessMiddleware, caller_of
from gear_rattle.service.access.revocation import RevocationWatcher
from gear_rattle.service.explorer.page.mount import Explorer
from gear_rattle.service.jobs.broadcast import SurveyEventBroadcaster
from gear_rattle.service.jobs.manager import JobManager
from gear_rattle.service.jobs.opening import open_service_data
from gear_rattle.service.jobs.recovery import clean_up_unfinished_work
from gear_rattle.service.kernels import KernelCompiler
from gear_rattle.service.observability.logs import format_logs_of_libraries
from gear_rattle.service.observability.metrics import Metrics
from gear_rattle.service.observability.request_log import RequestLogMiddleware
from gear_rattle.service.operations.overlaid import Overlays
from gear_rattle.service.routes import ROUTERS, health
from gear_rattle.service.settings import Settings
from gear_rattle.service.state import ApplicationState
from gear_rattle.service.web import problems
from gear_rattle.service.web.conditional import IfNoneMatchAnyMiddleware
from gear_rattle.service.web.documents import documents_app
from gear_rattle.service.web.head import HeadRequestMiddleware
from gear_rattle.service.web.prefix import PrefixMiddleware, public_path
from gear_rattle.service.web.queries import refuse_unknown_query_parameters
from rattle.numerics import remove_working_directory_from_path

if TYPE_CHECKING:
    from distributed import Client

#: Methods and headers that pages of the origins in `Settings.cors_origins` may use.
CORS_OPTIONS: dict[str, Any] = {
    "allow_methods": ["GET", "HEAD"],
    "allow_headers": ["Authorization", "If-None-Match", "Range"],
    "expose_headers": ["Content-Disposition", "Content-Range", "ETag", "Link", "Retry-After"],
}
DOCUMENTS = Path(__file__).with_name("help")  # directory of the site that `make docs` builds
SOURCES = Path(__file__).with_name("documents")  # a link to docs/; a wheel contains copies of the files
#: Niceness of worker processes, so that the service answers requests before workers compute tiles. At 19, a worker
#: beside two busy programs would get 1.4 % of a core.
WORKERS_NICE = 5

Cluster = Callable[[], AbstractContextManager["Client"]]
#: A function that opens the cluster. Its argument is a function that returns whether the start-up was cancelled, and
#: that is called repeatedly while the cluster starts.
StartCluster = Callable[[Callable[[], bool]], AbstractContextManager["Client"]]
Lifespan = Callable[[FastAPI], AbstractAsyncContextManager[None]]


def create_app(settings: Settings | None = None, cluster: Cluster | None = None) -> FastAPI:
    """Build the application.

    Parameters
    ----------
    settings : Settings | None
        The settings of the service; by default from the environment.
    cluster : Cluster | None
        Function that opens the dask cluster; by default the scheduler of the settings, or an embedded cluster.

    Returns
    -------
    FastAPI
        The application with all routes and middlewares and, unless `Settings.explorer` is False, the explorer.
    """
    settings = settings or Settings()
    metrics = Metrics()
    app = FastAPIOffline(
        title="gear rattle",
        summary="Surveys of the damping-eccentricity plane of an impacting gear model.",
        version=rattle.__version__,
        lifespan=_lifespan(settings, _cluster_starter(settings, cluster), metrics),
        responses=problems.declare_problems(*problems.STATUSES_OF_ANY_ROUTE),
        redirect_slashes=False,
        generate_unique_id_function=lambda route: route.name,
        static_url=REFERENCE_ASSETS,
        swagger_ui_parameters={"validatorUrl": None},  # no validator of another host gets our OpenAPI document
    )
    app.add_middleware(IfNoneMatchAnyMiddleware)
    app.add_middleware(HeadRequestMiddleware)
    app.add_middleware(RequestBodyLimitMiddleware, max_body_size=settings.max_body_bytes)
    app.add_middleware(problems.ProblemMiddleware)
    app.add_middleware(AccessMiddleware, settings=settings)
    if settings.cors_origins:  # pages of these origins may read, but never write
        app.add_middleware(CORSMiddleware, allow_origins=settings.cors_origins, **CORS_OPTIONS)
    app.add_middleware(RequestLogMiddleware, metrics=metrics)
    app.add_middleware(PrefixMiddleware, root_path=settings.root_path, trusted=settings.behind_proxy)
    problems.install_error_handlers(app)
    app.include_router(health.router, dependencies=[Depends(refuse_unknown_query_parameters)])
    for router in ROUTERS:
        app.include_router(
            router,
            dependencies=[Depends(caller_of), Depends(refuse_unknown_query_parameters)],
            responses=problems.declare_problems(401),
        )
    if (documents := documents_app(DOCUMENTS, SOURCES)) is not None:
        app.add_route("/help", lambda _: RedirectResponse(public_path("/help/")), include_in_schema=False)
        app.mount("/help", documents, name="help")
    app.state.explorer = Explorer(app, settings) if settings.explorer else None
    app.state.on_start = lambda: None  # `run_server` replaces this by the function to call when the service has started
    return app


def _cluster_starter(settings: Settings, cluster: Cluster | None) -> StartCluster:
    if cluster:
        return lambda _: cluster()
    if settings.scheduler:
        url = settings.scheduler
        return lambda _: workers.connect(url)
    return lambda should_stop: workers.embedded_cluster(settings.workers, WORKERS_NICE, should_stop)


def _lifespan(
    settings: Settings, cluster: StartCluster, metrics: Metrics
) -> Callable[[FastAPI], AbstractAsyncContextManager[None]]:
    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        remove_working_directory_from_path()
        format_logs_of_libraries()
        broadcast = SurveyEventBroadcaster()
        with open_service_data(settings, broadcast.notify) as (directory, database):
            clean_up_unfinished_work(database, directory)
            manager = JobManager(database, directory, cluster, metrics.count_tile)
            metrics.add_scraped_metrics(database, manager)
            app.state.front = ApplicationState(
                settings=settings,
                directory=directory,
                database=database,
                manager=manager,
                broadcast=broadcast,
                metrics=metrics,
                picture_limiter=CapacityLimiter(1),
                export_limiter=CapacityLimiter(1),
                point_limiter=CapacityLimiter(settings.max_points),
                kernels=KernelCompiler(settings),
                revocations=RevocationWatcher(database),
            )
            manager.start()
            app.state.overlaid = overlaid = Overlays(app.state.front)
            explorer = app.state.explorer.serve_pages(app.state.front, overlaid) if settings.explorer else nullcontext()
            try:
                async with app.state.front.kernels.lifespan(), app.state.front.revocations.lifespan(), explorer:
                    app.state.on_start()
                    yield
            finally:
                await run_in_threadpool(manager.stop)

    return lifespan
