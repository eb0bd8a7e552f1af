"""`rattle paper` can fail, and docs/paper.md says what it prints."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from depth import DEEP
from typer.testing import CliRunner

from gear_rattle.service.cli import app
from rattle import paper
from rattle.crisis import boundary_crisis
from rattle.paper import numbers
from rattle.paper.records import AGREES, OFF, UNDECIDED

DOCUMENT = (Path(__file__).parents[3] / "docs" / "paper.md").read_text()
NUMBER = re.compile(r"\d+\.\d+")
INTERVAL = 1e-5  # trajectories near a crisis differ from machine to machine


def exact_end(delta: float, *_: float) -> tuple[float, float]:
    """About the boundary crisis, instead of a bisection on 13 million impacts a step."""
    end = boundary_crisis(delta).epsilon
    return end - 1e-6, end + 1e-6


@pytest.fixture(scope="module")
def report() -> paper.Report:
    """Everything, computed once."""
    with pytest.MonkeyPatch.context() as patch:
        if not DEEP:
            patch.setattr(numbers, "bracket_end_of_chaos", exact_end)
        return paper.report()


@pytest.fixture
def computed(report: paper.Report, monkeypatch: pytest.MonkeyPatch) -> paper.Report:
    """The command computes its numbers, and takes what costs more from the report."""
    intervals = {x.what: x.computed for x in report.numbers if isinstance(x.computed, tuple)}
    monkeypatch.setattr(
        numbers, "bracket_end_of_chaos", lambda delta, *_: intervals[f"chaotic attractor ends at δ = {delta}"]
    )
    module = __import__("rattle.paper.report", fromlist=["report"])
    monkeypatch.setattr(module, "compute_statements", lambda *_: report.statements)
    monkeypatch.setattr(module, "compute_findings", lambda *_: report.findings)
    return report


def test_nothing_is_unexpected(report):
    assert report.deviations == ()
    assert len(report.numbers) == len(numbers.STATED)


def test_the_document_is_what_the_command_prints(report):
    """To the last digit but one; basin fractions, whose boundaries are fractal, to 0.003."""
    ours, shown = paper.markdown(report).splitlines(), DOCUMENT.splitlines()
    assert len(ours) == len(shown)
    for one, other in zip(ours, shown, strict=True):
        assert NUMBER.sub("#", one) == NUMBER.sub("#", other)
        for a, b in zip(NUMBER.findall(one), NUMBER.findall(other), strict=True):
            tolerance = INTERVAL if "attractor ends" in one else 3.0 * 10.0 ** -len(a.split(".")[1])
            assert float(a) == pytest.approx(float(b), abs=tolerance)


def test_the_command_shows_every_number(computed):
    result = CliRunner().invoke(app, ["paper"])
    assert result.exit_code == 0, result.output
    for number in computed.numbers:
        assert number.paper in result.output
    for finding in computed.findings:
        assert finding.title in result.output.replace("\n", " ")
    printed = CliRunner().invoke(app, ["paper", "--markdown"])
    assert printed.exit_code == 0
    assert printed.output.splitlines()[:20] == paper.markdown(computed).splitlines()[:20]


@pytest.mark.usefixtures("computed")
def test_a_wrong_value_in_the_paper_makes_the_command_fail(monkeypatch):
    monkeypatch.setitem(numbers.STATED, "SN1 at δ = 0.6", ("5.1", "≈ 0.0598", ""))
    result = CliRunner().invoke(app, ["paper"])
    assert result.exit_code == 1
    assert "unexpected: SN1 at δ = 0.6" in result.output


@pytest.mark.usefixtures("computed")
def test_a_wrong_computed_value_makes_the_command_fail(monkeypatch):
    right = numbers.epsilon_on_curve
    monkeypatch.setattr(numbers, "epsilon_on_curve", lambda curve, delta: right(curve, delta) + 2e-4 * (curve == "G1"))
    result = CliRunner().invoke(app, ["paper"])
    assert result.exit_code == 1
    assert "unexpected: G1 at δ = 0.6" in result.output
    assert "unexpected: SN1" not in result.output


def test_a_finding_without_evidence_or_need_is_unexpected(report):
    first = report.findings[0]
    doubtful = replace(first, evidence=(replace(first.evidence[0], holds=False), *first.evidence[1:]))
    assert replace(report, findings=(doubtful, *report.findings[1:])).deviations
    off = next(x for x in report.numbers if x.finding)
    assert not replace(off, computed=float(off.printed_value)).is_as_expected
    assert report.finding_number(off.finding) <= len(report.findings)
    assert replace(report, statements=(replace(report.statements[0], holds=False),)).deviations


@pytest.mark.parametrize(
    ("stated", "computed", "verdict"),
    [
        ("0.076", 0.0765, AGREES),
        ("0.076", 0.07651, OFF),
        ("≈ 0.076", 0.077, AGREES),
        ("≈ 0.076", 0.07701, OFF),
        ("≈ 0.7590", 0.75891, AGREES),
        ("≈ 0.7590", 0.75889, OFF),
        ("≈ 0.1109", (0.1108, 0.1110), AGREES),
        ("≈ 0.1109", (0.1109, 0.1111), UNDECIDED),
        ("≈ 0.1109", (0.1112, 0.1113), OFF),
        ("≈ 0.1109", float("nan"), OFF),
    ],
)
def test_the_rule(stated, computed, verdict):
    number = paper.StatedNumber("5.1", "something", stated, computed)
    assert number.verdict == verdict
    assert number.is_as_expected == (verdict == AGREES)


def test_the_end_of_chaos_agrees_with_the_manifold_condition(report):
    """At δ = 0.762 the corner of W^u(A) lands on W^s(A) at this ε; beyond it by less than the watch can tell."""
    low, high = next(x.interval for x in report.numbers if x.what == "chaotic attractor ends at δ = 0.762")
    assert low - 1e-6 < 0.0974223487 < high


def test_one_finding_is_computed_alone(monkeypatch):
    """It has its number and its entry in the whole report, and nothing else is computed."""
    monkeypatch.setattr(numbers, "bracket_end_of_chaos", None)
    monkeypatch.setattr(paper.report.__globals__["pictures"], "compute_figure_4_attractors", None)
    result = CliRunner().invoke(app, ["paper", "--only", "5"])
    assert result.exit_code == 0, result.output
    (title,) = re.findall(r"^### 5\. (.*)$", DOCUMENT, re.MULTILINE)
    assert f"5. {title}" in result.output.replace("\n", " ")
    assert not re.search(r"^(1|2|3|4|6)\. ", result.output, re.MULTILINE)
    assert result.output.splitlines()[-1] == "1 of 1 findings are borne out"
    for number in ("0", "13"):
        refused = CliRunner().invoke(app, ["paper", "--only", number])
        assert refused.exit_code != 0
        assert "choose a number from 1 to 12" in str(refused.exception)


def test_the_summary_is_last_and_counts_what_the_document_says(computed):
    result = CliRunner().invoke(app, ["paper"])
    agree = sum(number.verdict == AGREES for number in computed.numbers)
    last = result.output.strip().splitlines()[-1]
    assert last == computed.summary
    assert last.startswith(f"{agree} of {len(computed.numbers)} numbers agree")
    assert last.endswith("12 of 12 findings are borne out")
