"""`make bench`: every part prints whole tables of positive figures. How large they are is no contract."""

import io
import math
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest
from bench import cells, curves, global_dynamics, measure, peers
from bench.__main__ import Part, app
from depth import deep
from distributed import Client, LocalCluster
from typer.testing import CliRunner

from gear_rattle import workers

TINY = ["--thin", "512", "--row", "2", "--sample", "4", "--count", "4", "--side", "8", "--workers", "1"]


def printed(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> str:
    monkeypatch.setenv("COLUMNS", "200")
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return result.output


def rows(output: str) -> dict[str, list[str]]:
    """The cells of every row of every table, by the first one."""
    cells = [[cell.strip() for cell in line.strip("│").split("│")] for line in output.splitlines() if line[:1] == "│"]
    return {first: rest for first, *rest in cells}


def test_workloads_are_reproducible_states_on_the_upper_wall() -> None:
    first, again = measure.workloads(), measure.workloads()
    sizes = {name: states[0].size for name, states in first.items()}
    assert sizes == {"A": 4096, "B": 4096, "C": 64 * 64 * measure.PER_CELL}
    for name, states in first.items():
        assert all((x == y).all() and x.size == sizes[name] for x, y in zip(states, again[name], strict=True))
        assert all((x >= 0).all() for x in states)


def test_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "TURNS", 1)
    found = measure.rates(512)
    assert [rate.workload for rate in found] == list(measure.IMPACTS)
    assert all(rate.plain > 0 and rate.tangent > 0 and 0 <= rate.searched <= 1 >= rate.scanned >= 0 for rate in found)
    runners, scaling = next(measure.scaling(512))
    assert runners == "2 threads"
    assert scaling > 0
    monkeypatch.setattr(measure, "scaling", lambda _: [("2 threads", 2.0), ("2 processes", 1.9)])
    monkeypatch.setattr(measure, "portable", lambda _: {"this processor": (20.0, 22.0), "x86-64-v3": (21.0, 23.0)})
    table = rows(printed(monkeypatch, "kernel", *TINY))
    assert [*table] == ["A", "B", "C", "2 threads", "2 processes", "this processor", "x86-64-v3"]
    assert all(float(cells[0]) > 0 for cells in table.values())


def test_another_process_measures_when_asked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("\n\n"))
    measure.answer(512)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert all(len(line.split()) == 2 and float(word) > 0 for line in lines for word in line.split())


def test_cell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "TURNS", 1)
    monkeypatch.setattr(measure, "CELLS", {"quiet": (0.6, 0.056), "chaos": (0.6, 0.25)})
    table = rows(printed(monkeypatch, "cell", *TINY))
    assert {"quiet", "chaos", "all"} <= set(table)
    milliseconds, outcomes = measure.plane(4, 8)
    assert milliseconds > 0
    assert sum(each.samples for each in outcomes) == 4 * 8
    assert all(each.impacts > 0 and each.mean > 0 for each in outcomes)


def test_survey(monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def in_this_process(_: int) -> Iterator[Client]:
        alone = {"processes": False, "dashboard_address": "127.0.0.1:0"}  # whoever has the usual port
        cluster = LocalCluster(n_workers=1, threads_per_worker=1, **alone)
        with cluster, Client(cluster, set_as_default=False) as client:
            yield client

    monkeypatch.setattr(workers, "embedded_cluster", in_this_process)
    cost = measure.survey(8, 2, 1)
    assert cost.cells == 64
    parts = (cost.computing, cost.writing, cost.dask, cost.idle_end)
    assert cost.computing > 0 < cost.writing
    assert all(part >= 0 for part in parts), parts
    assert math.isclose(sum(parts), cost.seconds * cost.n_workers)
    assert cost.cells_per_second > 0 < cost.large_hours
    assert cost.front_mebibytes > 0 < cost.workers_mebibytes


def test_survey_table(monkeypatch: pytest.MonkeyPatch) -> None:
    cost = measure.SurveyCost(100, 2, 10.0, 15.0, 1.0, 0.5, 3.5, 200.0, 400.0)
    monkeypatch.setattr(measure, "survey", lambda *_: cost)
    monkeypatch.setattr(cells, "TURNS", 1)
    table = rows(printed(monkeypatch, "survey", "--sample", "4", "--count", "4", "--workers", "2"))
    assert table["processes computing"] == ["15.00 s", "75.00 %"]
    assert table["idle at the end, no tile left"] == ["3.50 s", "17.50 %"]
    assert table["cells per second"][0] == "10.0"
    assert table["1000 × 1000 cells would take, without the idle end"][0] == "22.92 h"
    assert [float(x) for x in table[cells.WHOLE][3:]] == pytest.approx(
        [sum(float(table[name][0].rstrip(" %")) / 100 * float(table[name][i]) for name in cells.NAMES) for i in (3, 4)],
        rel=0.05,  # the rarest class is printed as 1.3 % of the cells
    )


def test_classes_are_random_cells_beside_the_quiet_limit() -> None:
    sampled = cells.classes(16)
    assert [each.name for each in sampled] == list(cells.NAMES)
    assert sum(each.share for each in sampled) == pytest.approx(1.0)
    for each, low, high in zip(sampled, (0.0, *cells.EDGES), (*cells.EDGES, math.inf), strict=True):
        ratio = each.epsilon * np.hypot(2 * np.pi, each.delta) / (2 * each.delta)
        assert ((low <= ratio) & (ratio < high)).all()
        assert ratio.size == 16


def test_classes_beside_an_older_version(monkeypatch: pytest.MonkeyPatch) -> None:
    """The stored impacts are those of the cells that are measured: the plane is their mean."""
    reference, sampled = cells.F2F9D81, cells.classes()
    assert [each.delta.size for each in sampled] == [cells.PER_CLASS] * len(sampled)
    stored = [reference.costs[name] for name in cells.NAMES]
    for i, field in enumerate(("milliseconds", "impacts")):
        mean = sum(each.share * cost for each, cost in zip(sampled, (getattr(x, field) for x in stored), strict=True))
        assert getattr(reference.costs[cells.WHOLE], field) == pytest.approx(mean, rel=1e-3), i
    half = [
        cells.ClassCost(n, cells.Cost(c.milliseconds / 2, c.impacts), (1.0, 1.0, 1.0))
        for n, c in reference.costs.items()
    ]
    monkeypatch.setattr(
        measure, "survey", lambda *_: measure.SurveyCost(100, 2, 10.0, 15.0, 1.0, 0.5, 3.5, 200.0, 400.0)
    )
    monkeypatch.setattr(cells, "costs", lambda *_: half)
    table = rows(printed(monkeypatch, "survey"))
    assert all(table[name][-2:] == ["1.00", "0.50"] for name in (*cells.NAMES, cells.WHOLE))


def test_tables_of_what_is_measured_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curves, "bifurcations", lambda: iter([("Figures 7 and 8", 1.234, 4321)]))
    monkeypatch.setattr(global_dynamics, "times", lambda: iter([("Γ", 0.00456, "210 points")]))
    monkeypatch.setattr(measure, "start", lambda: iter([("rattle --version", 0.567)]))
    assert rows(printed(monkeypatch, "curves"))["Figures 7 and 8"] == ["1.23", "4321"]
    assert rows(printed(monkeypatch, "global"))["Γ"] == ["0.005", "210 points"]
    assert rows(printed(monkeypatch, "start"))["rattle --version"] == ["0.57"]


@deep
def test_curves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curves, "best", lambda _: [1.0])  # each has run once before it is timed
    table = rows(printed(monkeypatch, "curves"))
    assert int(table["Figures 7 and 8"][1]) > 300
    assert int(table["six period doublings of D"][1]) == 6
    assert all(float(cells[0]) > 0 for cells in table.values())


@deep
def test_global(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(global_dynamics, "SIDE", 20)
    monkeypatch.setattr(global_dynamics, "STEPS", 5)
    monkeypatch.setattr(global_dynamics, "ARCLENGTH", 2.0)
    monkeypatch.setattr(global_dynamics, "best_of_two", lambda run: run() or 1.0)
    monkeypatch.setattr(global_dynamics, "boundary_crisis", lambda _: SimpleNamespace(epsilon=0.0974223487))
    table = rows(printed(monkeypatch, "global"))
    assert table["basins, direct, 20 × 20 cells"] == ["1.000", f"{1e9 / 400:.0f} ns per cell"]
    assert table["boundary crisis at δ = 0.762"] == ["1.000", "ε = 0.0974223487"]
    assert len(table) == 10
    assert all(float(cells[0]) > 0 and cells[1] for cells in table.values())


def test_peers(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = peers.Peer("scipy", "1.0", 3000.0, 30.0, 1e-12, 1e-11, 400, 3)
    monkeypatch.setattr(peers, "peers", lambda: iter([measured]))
    monkeypatch.setattr(peers, "missing", lambda: {"heyoka": peers.INSTALL})
    table = rows(printed(monkeypatch, "peers"))
    assert table["scipy 1.0"] == ["3000", "30.0", "100", "1.0e-12", "1.0e-11", "400", "3"]
    assert peers.INSTALL in table["heyoka"][0]


@deep
def test_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure, "TURNS", 1)
    monkeypatch.setattr(measure, "FIRST_RESULT", "import rattle")
    table = rows(printed(monkeypatch, "start"))
    assert len(table) == 3
    assert all(float(cells[0]) > 0 for cells in table.values())


def test_help_names_every_part(monkeypatch: pytest.MonkeyPatch) -> None:
    text = printed(monkeypatch, "--help")
    assert all(f"{part}:" in text for part in Part)
