"""Blocks of the plane on which claims are proved: against what is computed at points, and against false claims."""

import json
import random
import shutil
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from depth import deep, either

import rattle.proof.areas.checker
from rattle.errors import NotProvedError
from rattle.impacting.map.quiet import capture_speed
from rattle.impacting.orbits.limits import quiet_limit
from rattle.impacting.orbits.period_one import period_one, regions
from rattle.proof.areas import one_impact, quiet_enclosure, two_impacts
from rattle.proof.areas.block import ABSENT, ATTRACTING, CAPTURED, LOUD, QUIET, REGIONS, SADDLE, ProvedBlock
from rattle.proof.areas.capture import _growth_coefficient, require_captures_below_speed
from rattle.proof.areas.checker.check import check
from rattle.proof.areas.checker.intervals import BlockRefusal
from rattle.proof.areas.columns import cut_into_columns, prove_column
from rattle.proof.areas.finder import BlockProver
from rattle.proof.areas.piece import PlanePiece, hull
from rattle.proof.areas.shares import shares_of_claims
from rattle.proof.balls import arb, arb_series, ball, precision

BETA, DELTA, EPSILON = Fraction(3, 5), (Fraction("0.4"), Fraction(1)), (Fraction(0), Fraction("0.3"))
KEPT = Path(__file__).parents[2] / "reference" / "areas.jsonl"  # every tenth column of docs/images/areas.png


def block_of(document):
    numbers = {name: tuple(map(Fraction, document[name])) for name in ("delta", "epsilon")}
    speed = document.get("speed")
    return ProvedBlock(document["claim"], Fraction(document["beta"]), **numbers, speed=speed and Fraction(speed))


BLOCKS = [block_of(json.loads(line)) for line in KEPT.read_text().splitlines()]


def piece_of(block):
    return PlanePiece(hull(*map(ball, block.delta)), hull(*map(ball, block.epsilon)), ball(block.beta))


def finder_says(block):
    """Why the finder refuses a block; "" if it proves it."""
    try:
        with precision(64):
            if block.claim == CAPTURED:
                require_captures_below_speed(piece_of(block), block.speed)
            else:
                BlockProver(block.beta).require_claim(block.claim, block.delta, block.epsilon)
    except NotProvedError as why:
        return str(why)
    return ""


def checker_says(block):
    try:
        check(block.json())
    except BlockRefusal as why:
        return str(why)
    return ""


def holds(claim, delta, epsilon, beta=0.6):
    """Return whether a claim holds at these points, in double precision."""
    orbits = period_one(delta, epsilon, beta)
    if claim in REGIONS:
        return regions(delta, epsilon, beta) == list(REGIONS).index(claim) + 1
    if claim in (QUIET, LOUD):
        return (epsilon < quiet_limit(delta)) == (claim == QUIET)
    i = "ABCD".index(claim[0])
    if claim == ABSENT.get(claim[0]):
        return ~orbits.exists[i]
    return orbits.exists[i] & (orbits.stable[i] == (claim == ATTRACTING[claim[0]]))


def test_what_is_proved_of_a_block_holds_at_its_points():
    rng, seen = np.random.default_rng(26), set()
    for block in BLOCKS:
        if block.claim == CAPTURED:
            continue
        delta, epsilon = (rng.uniform(*map(float, ends), either(10, 1000)) for ends in (block.delta, block.epsilon))
        assert holds(block.claim, delta, epsilon).all(), block
        seen.add(block.claim)
    assert seen == {*REGIONS, *ATTRACTING.values(), *SADDLE.values(), *ABSENT.values(), QUIET, LOUD}


def test_quiet_captures_below_what_is_proved():
    rng = np.random.default_rng(27)
    captured = [block for block in BLOCKS if block.claim == CAPTURED]
    for block in captured[:: either(9, 1)]:
        delta, epsilon = (float(rng.uniform(*map(float, ends))) for ends in (block.delta, block.epsilon))
        speed = float(block.speed)
        assert speed < capture_speed(delta, epsilon, 0.6)
        gear = rattle.Gear(delta, epsilon)
        tau, v, last = rng.random(), speed, np.inf
        for _ in range(60):
            force = 4 * np.pi * delta - 4 * np.pi**2 * epsilon * np.cos(2 * np.pi * tau)
            force -= 2 * np.pi * delta * epsilon * np.sin(2 * np.pi * tau)
            assert v**3 / force < last
            last = v**3 / force
            after = gear.impact(tau, v)
            tau, v = after.tau, after.v


def test_the_kept_columns_hold_what_the_whole_plane_does():
    tenth = (DELTA[1] - DELTA[0]) * (EPSILON[1] - EPSILON[0]) / 10
    found = {share.statement: share for share in shares_of_claims(BLOCKS, tenth)}
    assert found["the region"].proved > 0.99
    assert all(
        found[what].proved_where_true > 0.98
        for what in ("C is there", "C attracts", "D is there", "A is there, a saddle")
    )


def test_a_column_is_proved_and_proved_again():
    delta = cut_into_columns(DELTA, 2560)[2000]  # A and D begin in a graze
    blocks = prove_column(BETA, delta, EPSILON)
    assert {block.claim for block in blocks} == {"I", "V", ABSENT["C"], SADDLE["D"], ABSENT["D"], QUIET, LOUD, CAPTURED}
    told = sum(block.area for block in blocks if block.claim in REGIONS)
    assert told > Fraction("0.99") * (delta[1] - delta[0]) * EPSILON[1]
    for claim in either(
        (ABSENT["C"], LOUD, CAPTURED), ("I", "V", ABSENT["C"], SADDLE["D"], ABSENT["D"], LOUD, CAPTURED)
    ):
        assert not checker_says(next(block for block in blocks if block.claim == claim))


@deep
def test_kept_blocks_are_proved_again():
    for block in BLOCKS[::5]:
        assert not checker_says(block), block


def false_blocks(seed):
    """Blocks that reach beyond where their claim holds, at some point of theirs, or that claim something else."""
    rng = random.Random(seed)
    while True:
        block = rng.choice(BLOCKS)
        if block.claim == CAPTURED:
            faster = block.speed * 40
            yield ProvedBlock(CAPTURED, BETA, block.delta, block.epsilon, faster)
            continue
        if rng.random() < 0.5:
            claim = rng.choice([*REGIONS, *ATTRACTING.values(), *SADDLE.values(), *ABSENT.values(), QUIET, LOUD])
            block = ProvedBlock(claim, BETA, block.delta, block.epsilon)
        else:
            by = Fraction(rng.randint(-20, 20), 1000)
            low, high = (min(max(end + by, Fraction(0)), EPSILON[1]) for end in block.epsilon)
            block = ProvedBlock(block.claim, BETA, block.delta, (low, high))
        corners = [(float(d), float(e)) for d in block.delta for e in block.epsilon]
        if block.epsilon[0] < block.epsilon[1] and not holds(block.claim, *np.array(corners).T).all():
            yield block


def test_false_blocks_are_refused_by_finder_and_checker():
    given = false_blocks(26)
    for _ in range(either(2, 60)):
        block = next(given)
        assert finder_says(block), block
        assert checker_says(block), block


#: Just beyond each boundary: (claim, δ, ε), false at one edge.
BEYOND = [
    *(("I", delta, epsilon) for delta, epsilon in (("0.6 0.6001", "0.05 0.06"), ("0.9 0.9001", "0.1 0.168"))),
    ("I", "0.6 0.62", "0 0.0602"),
    *(("II", "0.6 0.6001", epsilon) for epsilon in ("0.059 0.065", "0.062 0.0692")),
    *(("III", "0.6 0.6001", epsilon) for epsilon in ("0.0682 0.074", "0.072 0.0766")),
    *(("IV", "0.6 0.6001", epsilon) for epsilon in ("0.0757 0.1", "0.1 0.145")),
    *(("V", delta, epsilon) for delta, epsilon in (("0.6 0.6001", "0.144 0.2"), ("0.9 0.9001", "0.1665 0.2"))),
    (ATTRACTING["C"], "0.6 0.6001", "0.1 0.145"),
    (ATTRACTING["C"], "0.5 0.5001", "0.1 0.1685"),
    (SADDLE["C"], "0.5 0.5001", "0.1665 0.2"),
    (ABSENT["C"], "0.6 0.6001", "0.144 0.2"),
    (ATTRACTING["D"], "0.6 0.6001", "0.072 0.0766"),
    *((SADDLE["D"], delta, epsilon) for delta, epsilon in (("0.6 0.6001", "0.0757 0.1"), ("0.9 0.9001", "0.1665 0.2"))),
    *((ABSENT["D"], delta, epsilon) for delta, epsilon in (("0.6 0.6001", "0.06 0.0692"), ("0.9 0.9001", "0.1 0.168"))),
    (QUIET, "0.6 0.6001", "0.1 0.1902"),
    (LOUD, "0.6 0.6001", "0.19 0.25"),
]


@pytest.mark.parametrize("case", BEYOND, ids=" ".join)
def test_a_block_beyond_a_boundary_is_refused(case):
    claim, *texts = case
    delta, epsilon = (tuple(map(Fraction, each.split())) for each in texts)
    corners = [(float(d), float(e)) for d in delta for e in epsilon]
    assert not holds(claim, *np.array(corners).T).all()
    block = ProvedBlock(claim, BETA, delta, epsilon)
    assert finder_says(block)
    if claim[0] not in "IVBD" or either(False, True):
        assert checker_says(block)


def test_how_much_higher_a_bounce_is_than_the_one_before():
    delta, epsilon, tau, v = 0.6, 0.1, 0.37, 0.01

    def force(t):
        turn = 2 * np.pi * t
        return 4 * np.pi * delta - 2 * np.pi * epsilon * (2 * np.pi * np.cos(turn) + delta * np.sin(turn))

    after = rattle.Gear(delta, epsilon).impact(tau, v)
    changed = 3 * np.log(after.v / v) - np.log(force(tau + after.time) / force(tau)) + delta * after.time
    half = np.tanh(delta * after.time / 2) / delta  # of the bounce, from its middle
    middle = tau + np.log1p(delta * half) / delta - np.arctan(delta / (2 * np.pi)) / (2 * np.pi)
    with precision(64):
        share = arb(epsilon) / quiet_enclosure.quiet_limit_enclosure(arb_series([arb(delta)]))[0]
        found = _growth_coefficient(arb(middle), arb(half), arb(delta), share)
    assert float(found.lower()) < changed / half**3 < float(found.upper())
    assert float(found.upper() - found.lower()) < 8 * abs(changed) / half**3


@pytest.mark.parametrize("letter", "AC")
def test_a_flight_of_one_impact_is_that_of_a_motion(letter):
    gear = rattle.Gear(0.6, 0.09)
    orbit = next(each for each in gear.orbits() if each.name == letter)
    x = 0.09 * np.cos(2 * np.pi * orbit.tau)
    with precision():
        piece = PlanePiece(arb(0.6), arb(0.09), arb(0.6))
        y = one_impact.minus_epsilon_sine(arb_series([piece.delta]))[0]
        assert float(one_impact.epsilon_cosine_enclosure(piece, letter, y)) == pytest.approx(x, abs=1e-13)
        s = arb(0.37)
        found, slope = (
            one_impact.flight_height(s, arb_series([piece.delta]), arb(x))[0],
            one_impact.velocity_enclosure(s, piece.delta, arb(x)),
        )
        c = (4 * np.pi - 2 * np.pi * 0.09 * np.sin(2 * np.pi * orbit.tau) + orbit.v) / 0.6
        t = orbit.tau + 0.37
        height = (
            c * np.expm1(-0.6 * 0.37)
            + 0.09 * (np.cos(2 * np.pi * t) - np.cos(2 * np.pi * orbit.tau))
            + 4 * np.pi * 0.37
        )
        assert float(found) == pytest.approx(height, abs=1e-12)
        swing = 2 * np.pi * 0.09 * np.sin(2 * np.pi * t)
        assert float(slope) == pytest.approx(-0.6 * c * np.exp(-0.6 * 0.37) - swing + 4 * np.pi)


@pytest.mark.parametrize("name", ["B", "D"])
def test_a_solution_of_two_impacts_is_a_motion(name):
    orbit = next(each for each in rattle.Gear(0.6, 0.09).orbits() if each.name == name)
    times = rattle.Gear(0.6, 0.09).orbit(orbit.tau, orbit.v).times
    s = float(times[1] - times[0])
    with precision():
        cell = two_impacts.SolutionCell(arb(s), arb(s), arb(0.6), arb(0.6))
        x, y, v, u = (float(each) for each in cell.solution.over_cell)
        assert (np.hypot(x, y), v) == pytest.approx((0.09, orbit.v), abs=1e-9)
        above, below = (float(each) for each in cell.stability_margin_bounds)
        trace = sum(orbit.multipliers).real
        assert 2 * above / (u * v) == pytest.approx(1 + np.exp(-0.6) - trace, rel=1e-6)
        assert 2 * below / (u * v) == pytest.approx(1 + np.exp(-0.6) + trace, rel=1e-6)
        assert (cell.epsilon_squared_s_derivative > 0) == (name == "D")


def test_documents_that_are_none_are_refused():
    good = BLOCKS[0].document()
    assert not checker_says(BLOCKS[0])
    for changes in (
        {"format": 2}, {"theorem": "motion"},
        {"claim": "VI"}, {"claim": None}, {"beta": "0"}, {"beta": 0.6}, {"delta": ["0", "0.1"]},
        {"delta": ["1"]},
        {"epsilon": ["0.1", "0"]}, {"epsilon": ["-0.1", "0"]}, {"epsilon": ["nan", "0"]}, {"claim": CAPTURED},
        {"claim": CAPTURED, "speed": "0"}, {"claim": CAPTURED, "speed": "9"},
    ):  # fmt: skip
        with pytest.raises(BlockRefusal):
            check(json.dumps({**good, **changes}))


def test_the_checker_needs_nobody(tmp_path):
    shutil.copytree(Path(rattle.proof.areas.checker.__file__).parent, tmp_path / "checker")
    for file in (tmp_path / "checker").glob("*.py"):
        assert len(file.read_text().splitlines()) < 250
    (tmp_path / "blocks.jsonl").write_text(BLOCKS[0].json() + "\n" + BLOCKS[0].json().replace('"I"', '"V"') + "\n")
    code = "import sys; sys.path.insert(0, '.'); from checker.check import main; status = main('blocks.jsonl')\n"
    code += (
        "assert not any(name.split('.')[0] in ('rattle', 'flint', 'numpy') for name in sys.modules); sys.exit(status)"
    )
    said = subprocess.run([sys.executable, "-I", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert said.returncode == 1, said.stderr
    assert said.stdout.splitlines()[0].startswith("proved: I, δ 0.4 to")
    assert said.stdout.splitlines()[1].startswith("NOT PROVED, line 2: ")
