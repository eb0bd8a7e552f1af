"""Count events of a service for Prometheus. Each application has its own registry."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Protocol

from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest
from prometheus_client.core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from gear_rattle.service.database.tables import State

if TYPE_CHECKING:
    from gear_rattle.service.database import Database
    from gear_rattle.workers import TileRecord

BUCKET_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0, 60.0)


class ThreadCounter(Protocol):
    """An object, such as the job manager, that knows the number of the cluster's threads."""

    def count_cluster_threads(self) -> int:
        """Return the number of threads of the cluster; 0 without a cluster."""


class Metrics:
    """The metrics of one process: counters of tiles, cells and impacts, and a histogram of response times.

    Prometheus computes rates: ``rate(rattle_cells_total[1m])`` is cells per second.
    """

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self._tiles = Counter("rattle_tiles", "Tiles written by this process.", registry=self.registry)
        self._cells = Counter("rattle_cells", "Cells written by this process.", registry=self.registry)
        self._failed = Counter("rattle_cells_failed", "Cells among them without values.", registry=self.registry)
        self._impacts = Counter(
            "rattle_impacts", "Impacts that samples made in these cells, on one wall.", registry=self.registry
        )
        self._busy = Counter("rattle_tile_seconds", "Seconds of workers for these tiles.", registry=self.registry)
        self._requests = Histogram(
            "rattle_http_request_seconds",
            "From a request to the beginning of its answer.",
            ("method", "route", "status"),
            registry=self.registry,
            buckets=BUCKET_SECONDS,
        )

    def count_tile(self, record: TileRecord) -> None:
        """Count a written tile, with its cells, failures, impacts and seconds."""
        self._tiles.inc()
        self._cells.inc(record.cells)
        self._failed.inc(len(record.failed_cells))
        self._impacts.inc(record.impacts)
        self._busy.inc(record.seconds)

    def count_request(self, method: str, route: str, status: int, seconds: float) -> None:
        """Count a request. route: the template of its path, such as /v1/surveys/{survey_id}."""
        self._requests.labels(method, route, str(status)).observe(seconds)

    def add_scraped_metrics(self, database: Database, manager: ThreadCounter) -> None:
        """Add metrics of the job database and of the cluster, whose values are read whenever Prometheus asks."""
        self.registry.register(_ScrapedValues(database, manager))

    def exposition(self) -> bytes:
        """Return all metrics in Prometheus' text format."""
        return generate_latest(self.registry)


class _ScrapedValues(Collector):
    """Numbers of surveys, of tiles and of the cluster's threads, which are read whenever Prometheus asks (scrapes)."""

    def __init__(self, database: Database, manager: ThreadCounter) -> None:
        self._database = database
        self._manager = manager

    def describe(self) -> list[Metric]:
        # Registration calls this method, which must not read the database as `collect` does.
        return []

    def collect(self) -> Iterator[Metric]:
        totals = self._database.count_jobs_and_tiles()
        surveys = GaugeMetricFamily("rattle_surveys", "Surveys by state.", labels=["state"])
        tiles = GaugeMetricFamily("rattle_survey_tiles", "Tiles of all surveys by state.", labels=["state"])
        waiting = 0
        for state in State:
            count, n_tiles, done = totals.get(state, (0, 0, 0))
            surveys.add_metric([str(state)], count)
            waiting += 0 if state.is_final else n_tiles - done
        tiles.add_metric(["done"], sum(done for _, _, done in totals.values()))
        tiles.add_metric(["waiting"], waiting)
        yield surveys
        yield tiles
        accepted, _, _ = totals.get(State.ACCEPTED, (0, 0, 0))
        yield GaugeMetricFamily("rattle_queue_length", "Surveys that wait for their turn.", value=accepted)
        yield GaugeMetricFamily(
            "rattle_workers", "Threads of the cluster that compute.", value=self._manager.count_cluster_threads()
        )
