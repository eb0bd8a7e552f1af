"""Figures in the documents are what the programs give: each is computed, and compared to the last digit that is said.

The paper's numbers are compared in test_paper.py, the lines of docs/engineers.md in test_engineers.py, README's counts
in test_readme.py. Times, sizes and shares of long measurements are not here: the documents say how they were made.
"""

import json
import re
from collections.abc import Callable, Sequence
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from depth import deep
from scipy.optimize import brentq

import rattle
from gear_rattle.workers import SurveyRequest
from rattle import crisis, curves, inelastic, stiff
from rattle.attractors import classify
from rattle.attractors.speeds import PAPER_SPEED, highest_sampled_speed
from rattle.continuation.curve_continuation import Curve
from rattle.stiff import StiffGear

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
STORED = ROOT / "tests" / "reference" / "horseshoes.jsonl"  # what `rattle certify --point … --chaos` printed
NUMBER = r"(-?\d[\d,]*(?:\.\d+)?(?:e-?\d+)?)"


class Claim(NamedTuple):
    """Numbers that a document states, # in its text, and what they are."""

    document: str
    text: str
    computed: Callable[[], Sequence[float]]


def lowest(curve: Curve, **place: float) -> float:
    """The least of the values that a curve has there."""
    return float(min(curve.at(**place)))


def traced(name: str, delta: float = 0.6) -> float:
    return lowest(curves.trace(name, delta=(delta - 0.01, delta + 0.01)), delta=delta)


def softened(name: str, kappa: float, delta: float = 0.6) -> float:
    return lowest(stiff.trace(name, kappa=kappa, delta=(delta - 0.01, delta + 0.01)), delta=delta)


def limit_row(name: str, delta: float = 0.6) -> Callable[[], Sequence[float]]:
    return lambda: [traced(name, delta), *(softened(name, kappa, delta) for kappa in (1e4, 1e6, 1e8))]


def point(name: str) -> tuple[float, float]:
    (found,) = [each for each in curves.codimension_two() if each.name == name]
    return found.delta, found.epsilon


def met_at(name: str, r: float) -> tuple[float, float]:
    return inelastic.follow_codimension_two(name).at(r)


def region_shares(r: float) -> list[float]:
    delta, epsilon = np.meshgrid(np.linspace(0.4, 1.0, 240), np.linspace(0.00125, 0.3, 240))
    found = inelastic.regions(delta, epsilon, 0.6, r)
    return [float((found == region).mean()) for region in range(1, 6)]


def crosses_the_quiet_limit(name: str) -> float:
    def above(r: float) -> float:
        delta, epsilon = met_at(name, r)
        return epsilon - float(rattle.quiet_limit(delta))

    return float(brentq(above, 0.5, 0.9))


def end_of(name: str) -> list[float]:
    curve = inelastic.follow_codimension_two(name)
    return [float(each[-1]) for each in (curve.restitution, curve.delta, curve.epsilon)]


def mesh(rpm: float) -> float:
    return float(rattle.Machine(0.003, 5e-4, 100e-6, 15e-6, 0.05, rpm=rpm, stiffness=4e8).kappa)


QUICK = [
    Claim(
        "labels.md",
        "an observation of # forcing periods and # relaxation times 1/δ",
        lambda: [classify.PERIODS, classify.WATCH],
    ),
    Claim("labels.md", "At δ = 0.001 that is # periods.", lambda: [classify.WATCH / 0.001]),
    Claim("labels.md", "at most `budget` impacts on Σ⁺ (# by default", lambda: [classify.BUDGET]),
    Claim("labels.md", "v_max is # in the paper's plane", lambda: [PAPER_SPEED]),
    Claim("labels.md", "at (0.6, 0.1, 0.6) that is #.", lambda: [highest_sampled_speed("natural", 0.6, 0.1, 0.6)]),
    Claim(
        "labels.md", "the first # attractors of a cell, # where δ begins below 0.1", lambda: [slots(0.4), slots(0.05)]
    ),
    Claim(
        "resilience.md",
        "C's birth at ε = #, D's at # and its flip at #, to nine digits those of SN1, SN2 and PD1",
        lambda: [traced(name) for name in ("SN1", "SN2", "PD1")],
    ),
    Claim("figures.md", "COD23, at (#, #), a ninth", lambda: point("COD23")),
    Claim("paper.md", "COD21 (#, #), COD23 (#, #)", lambda: [*point("COD21"), *point("COD23")]),
    Claim("stiff.md", "| SN1 | # | # | # | # |", limit_row("SN1")),
    Claim("stiff.md", "| SN2 | # | # | # | # |", limit_row("SN2")),
    Claim("stiff.md", "| PD1 | # | # | # | # |", limit_row("PD1")),
    Claim("stiff.md", "| PDC at δ = 0.45 | # | # | # | # |", limit_row("PDC", 0.45)),
    Claim("stiff.md", "| PD2 at δ = 0.5 | # | # | # | # |", limit_row("PD2", 0.5)),
    Claim("stiff.md", "| fold of C and B, at G1 | # | # | # | # |", limit_row("G1")),
    Claim(
        "stiff.md",
        "| quiet limit | # | # | # | # |",
        lambda: [rattle.quiet_limit(0.6), *(StiffGear(0.6, 0.1, kappa=k).quiet_limit for k in (1e4, 1e6, 1e8))],
    ),
    Claim(
        "weak-damping.md",
        "κ is # at 3000 rpm, # at 1000 and # at 300",
        lambda: [mesh(rpm) for rpm in (3000, 1000, 300)],
    ),
    Claim(
        "weak-damping.md",
        "lasts π/√(2κ) periods, # % at 3000 rpm and # % at 300",
        lambda: [100 * 3.14159265 / (2 * mesh(rpm)) ** 0.5 for rpm in (3000, 300)],
    ),
    *(
        Claim(
            "restitution.md",
            f"| {name} | (#, #) | (#, #) | (#, #) | (#, #) | (#, #) | (#, #) |",
            lambda name=name: [x for r in (1.0, 0.98, 0.95, 0.9, 0.8, 0.5) for x in met_at(name, r)],
        )
        for name in ("COD20", "COD21", "COD23", "COD22")
    ),
    *(
        Claim("restitution.md", f"| {r} | # | # | # | # | # |\n", lambda r=r: region_shares(float(r)))
        for r in ("1", "0.9", "0.8", "0.6")
    ),
    Claim(
        "restitution.md",
        "r = 0.9 SN1 is # and the flip #",
        lambda: [f(0.6, 0.9, 4 * np.pi) for f in (inelastic.epsilon_of_saddle_node, inelastic.epsilon_of_flip_of_c)],
    ),
    Claim(
        "restitution.md",
        "At r = # COD22 crosses the quiet limit**, at r = # COD23 does",
        lambda: [crosses_the_quiet_limit(name) for name in ("COD22", "COD23")],
    ),
    Claim("restitution.md", "COD22 ends at r = #**, at (#, #)", lambda: end_of("COD22")),
    Claim(
        "restitution.md",
        "COD22 − COD23 in δ is # at r = 1, # at 0.9 and # at 0.5",
        lambda: [met_at("COD22", r)[0] - met_at("COD23", r)[0] for r in (1.0, 0.9, 0.5)],
    ),
    Claim(
        "restitution.md",
        "Their distance in δ is # at r = 1 and largest, #, near r = 0.5; at r = 0.001 it is #",
        lambda: [met_at("COD23", r)[0] - met_at("COD21", r)[0] for r in (1.0, 0.5, 0.001)],
    ),
]

DEEP = [
    Claim("crisis.md", f"| {delta} | # | {kind} |", lambda delta=delta: [crisis.boundary_crisis(delta).epsilon])
    for delta, kind in ((0.6, "tangency"), (0.65, "tangency"), (0.7, "tangency"), (0.762, "corner"))
] + [
    Claim(
        "proofs.md",
        "exponent seen is #, # and # a forcing period",
        lambda: [exponent(*place) for place in ((0.6, 0.1), (0.7645, 0.0968), (0.05, 0.0239))],
    )
]


def exponent(delta: float, epsilon: float) -> float:
    (found,) = [each for each in rattle.Gear(delta, epsilon).attractors(1024) if each.kind == "chaotic"]
    return found.lyapunov[0]


def slots(delta: float) -> int:
    axes = {"delta": {"start": delta, "stop": 1.0, "num": 2}, "epsilon": {"start": 0.01, "stop": 0.3, "num": 2}}
    return SurveyRequest.model_validate(axes).n_slots


def said(claim: Claim) -> list[str]:
    """The numbers that the document has in place of #; it says it once."""
    pattern = re.escape(claim.text).replace(r"\#", NUMBER).replace(r"\ ", r"\s+")
    found = re.findall(pattern, (DOCS / claim.document).read_text())
    assert len(found) == 1, f"{claim.document} says {claim.text!r} {len(found)} times"
    return [found[0]] if isinstance(found[0], str) else list(found[0])


def require_said(claim: Claim) -> None:
    """Each number is the computed one to its last digit, which rounding may move."""
    texts, computed = said(claim), list(claim.computed())
    assert len(texts) == len(computed)
    for text, value in zip(texts, computed, strict=True):
        number = Decimal(text.replace(",", ""))
        unit = Decimal(1).scaleb(int(number.as_tuple().exponent))
        assert abs(Decimal(float(value)) - number) <= unit * Decimal("1.01"), (claim.document, claim.text, text, value)


@pytest.mark.parametrize("claim", QUICK, ids=lambda claim: f"{claim.document} {claim.text[:30]}")
def test_a_document_says_what_the_programs_give(claim: Claim) -> None:
    require_said(claim)


@deep
@pytest.mark.parametrize("claim", DEEP, ids=lambda claim: f"{claim.document} {claim.text[:30]}")
def test_a_document_says_what_a_longer_run_gives(claim: Claim) -> None:
    require_said(claim)


def test_a_wrong_number_is_noticed() -> None:
    claim = QUICK[0]
    with pytest.raises(AssertionError, match=r"labels\.md"):
        require_said(claim._replace(computed=lambda: [classify.PERIODS, 3 * classify.WATCH]))
    with pytest.raises(AssertionError, match="0 times"):
        require_said(claim._replace(text="an observation of # years"))


@pytest.mark.parametrize("gear", [rattle.Gear, StiffGear])
def test_docstrings_give_the_watch_and_the_budget_that_the_classifier_has(gear: type) -> None:
    text = " ".join(str(gear.attractors.__doc__).split())  # type: ignore[attr-defined]
    for number, what in re.findall(r"(\d+) (relaxation times|periods)", text):
        assert float(number) == {"relaxation times": classify.WATCH, "periods": classify.PERIODS}[what]


ROW = re.compile(r"^\| ([\d.]+) \| ([\d.]+) \| .*? \| ([\d, ]+) \| ([\d.]+) \| ([\d.]+) \|$", re.MULTILINE)


def rows_of_horseshoes() -> dict[str, tuple[list[int], str, str]]:
    return {
        delta: ([int(number) for number in lengths.split(",")], impact, period)
        for delta, _, lengths, impact, period in ROW.findall((DOCS / "proofs.md").read_text())
    }


def row_of(document: dict) -> tuple[list[int], str, str]:
    lengths = sorted(len(loop["sigma_minus"]) for loop in document["loops"])
    return lengths, document["entropy_per_impact"], document["entropy_per_period"]


def test_horseshoes_in_the_document_are_the_stored_ones() -> None:
    stored = [json.loads(line) for line in STORED.read_text().splitlines()]
    assert rows_of_horseshoes() == {each["parameters"]["delta"]: row_of(each) for each in stored}


@deep
def test_horseshoes_in_the_document_are_those_that_the_command_proves() -> None:
    from rattle.proof.chaos.prove import certify_chaos

    rows = rows_of_horseshoes()
    for line in STORED.read_text().splitlines():
        numbers = json.loads(line)["parameters"]
        assert row_of(json.loads(certify_chaos(**numbers).json())) == rows[numbers["delta"]]


def test_points_of_codimension_two_in_the_document_are_enclosed() -> None:
    """To all digits that stand there."""
    from rattle.proof.bifurcations.prove import certify_codimension_two

    text = (DOCS / "proofs.md").read_text()
    proved = {each.name: each for each in certify_codimension_two("0.6")}
    found = re.findall(r"^\| (COD2\d) \| ([\d.]+) \| ([\d.]+) \| proved \|$", text, re.MULTILINE)
    assert len(found) == len(proved) == 4
    for name, *numbers in found:
        document = proved[name].document()
        for number, key in zip(numbers, ("delta", "epsilon"), strict=True):
            low, high = (Decimal(end) for end in document["solved"][key])
            assert abs(Decimal(number) - low) <= Decimal("1e-18")
            assert high - low <= Decimal("1e-18")
