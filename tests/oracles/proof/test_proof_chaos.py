"""Horseshoes: images hold what the impact map does, coverings are proved again, and false ones are refused."""

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from depth import deep, either
from flint import arb, arb_mat

import rattle
from rattle.proof import check as shared
from rattle.proof.balls import ball, precision
from rattle.proof.chaos import check, coverings, images, prove, search
from rattle.proof.check import Refusal
from rattle.proof.flights import ModelPoint

STORED = (
    Path(__file__).parents[2] / "reference" / "horseshoes.jsonl"
)  # as `rattle certify --point … --chaos` wrote them
POINTS = ["0.6", "0.7645", "0.05"]


@pytest.fixture(scope="module")
def stored():
    documents = [json.loads(line) for line in STORED.read_text().splitlines()]
    return {each["parameters"]["delta"]: each for each in documents}


def point_of(document):
    return ModelPoint(*(ball(Fraction(document["parameters"][name])) for name in ("delta", "epsilon", "beta")))


def sets_of(document):
    numbers = [[Fraction(x) for x in each] for each in document["sets"]]
    return [coverings.HSet((x[0], x[1]), (x[2], x[3]), (x[4], x[5])) for x in numbers]


def steps_of(document):
    """(source, target, Σ⁻ impacts, periods) of all coverings."""
    for loop in document["loops"]:
        chain = [0, *loop["sets"], 0]
        yield from zip(chain[:-1], chain[1:], loop["sigma_minus"], loop["periods"], strict=True)


def test_a_horseshoe_is_stored_of_each_point_asked_for(stored):
    assert list(stored) == POINTS
    low, high = rattle.robust_chaos_interval(0.6)
    assert abs(0.7645 - (low + high) / 2) < 1e-3
    (graze,) = rattle.curves.trace("G1", delta=(0.76, 0.769)).at(delta=0.7645)
    assert 0 < 0.0968 - graze < 3e-4


def test_images_hold_what_the_impact_map_does(stored):
    """The states are random, in random small parts of sets; both programs are tested."""
    rng = np.random.default_rng(1)
    for document in stored.values():
        gear = rattle.Gear(*(float(document["parameters"][name]) for name in ("delta", "epsilon", "beta")))
        pi, claim = search.ReturnMap(gear), check.HorseshoeClaim(document)
        with precision():
            point, sets = point_of(document), sets_of(document)
            steps = list(steps_of(document))
            for k in rng.choice(len(steps), 4):
                source, _, word, _ = steps[k]
                xi, eta, size = *rng.uniform(-0.9, 0.9, 2), 2.0**-7
                found = coverings.MappedSet(point, sets[source], (-1,) * word).image(
                    coverings.SetPart(xi, eta, size, size)
                )
                middle, sides = claim.image(source, (xi, eta, size, size), word)
                for _ in range(5):
                    at = rng.uniform(-1, 1, 2)
                    a = np.array(document["sets"][source], float)
                    x = a[:2] + a[2:4] * (xi + size * at[0]) + a[4:] * (eta + size * at[1])
                    after, words = pi(x)
                    assert words == word
                    for i in range(2):
                        ours = found.middle[i] + sum((found.slope[i, j] * arb(at[j]) for j in range(2)), arb(0))
                        theirs = middle[i] + sum((sides[j][i] * shared.IV.mpf(at[j]) for j in range(2)), shared.ZERO)
                        off = round(float(ours.mid()) - after[i]) if i == 0 else 0
                        assert ours.overlaps(arb(after[i] + off, 1e-9))
                        assert float(theirs.a) - 1e-9 <= after[i] + off <= float(theirs.b) + 1e-9


@pytest.mark.parametrize("delta", POINTS)
def test_coverings_are_proved_again_in_balls(stored, delta):
    document = stored[delta]
    with precision():
        point, sets = point_of(document), sets_of(document)
        for source, target, word, periods in list(steps_of(document))[:3]:
            coverings.MappedSet(point, sets[source], (-1,) * word).require_covering(sets[target], periods)
        heads = [sets[(*loop["sets"], 0)[0]] for loop in document["loops"]]
        for i, head in enumerate(heads):
            prove.require_disjoint_sets([head], heads[:i])


@pytest.mark.parametrize("delta", either(POINTS[1:2], POINTS))
def test_the_checker_proves_a_covering_and_refuses_what_is_none(stored, delta):
    claim = check.HorseshoeClaim(stored[delta])
    source, target, word, periods = next(step for step in steps_of(stored[delta]) if step[0] > 0)
    claim.require_covering(source, target, word, periods)
    with pytest.raises(Refusal):
        claim.require_covering(source, target, word, periods + 1)
    with pytest.raises(Refusal):
        claim.require_covering(source, source, word, periods)


@deep
@pytest.mark.parametrize("delta", POINTS)
def test_the_checker_proves_all_of_it(stored, delta):
    assert "a horseshoe of entropy 0." in check.check(json.dumps(stored[delta]))


def moved(target, by_unstable, by_stable):
    shift = [by_unstable * u + by_stable * s for u, s in zip(target.unstable, target.stable, strict=True)]
    return coverings.HSet((target.centre[0] + shift[0], target.centre[1] + shift[1]), target.unstable, target.stable)


def test_sets_that_are_not_covered_are_refused(stored):
    """Moved across or along, wider, flatter, with another word, at another point of the plane."""
    document = stored["0.6"]
    with precision():
        point, sets = point_of(document), sets_of(document)
        (source, target, word, periods), *_ = list(steps_of(document))[2:]  # those before reach further than their ends
        mapped = coverings.MappedSet(point, sets[source], (-1,) * word)
        end = sets[target]
        mapped.require_covering(end, periods)
        (a, b), (c, d) = end.unstable, end.stable
        false = [
            moved(end, Fraction(1), Fraction(0)),
            moved(end, Fraction(-1), Fraction(0)),
            moved(end, Fraction(0), Fraction(2)),
            coverings.HSet(end.centre, (2 * a, 2 * b), end.stable),
            coverings.HSet(end.centre, end.unstable, (c / 1000, d / 1000)),
            coverings.HSet(end.centre, end.stable, end.unstable),
        ]
        for wrong in false:
            with pytest.raises(rattle.NotProvedError):
                mapped.require_covering(wrong, periods)
        with pytest.raises(rattle.NotProvedError):
            mapped.require_covering(end, periods + 1)
        with pytest.raises(rattle.NotProvedError):
            coverings.MappedSet(point, sets[source], (-1,) * (1 - word)).require_covering(end, periods)


def test_a_motion_that_passes_a_wall_has_no_image(stored):
    """Departures about the hub that are said to miss Σ⁻ where they meet it, and a set that reaches across Γ."""
    with precision():
        point = point_of(stored["0.6"])
        d = next(orbit for orbit in rattle.Gear(0.6, 0.1).orbits() if orbit.name == "D")
        small = arb_mat([[1e-6, 0], [0, 1e-6]])
        images.enclose_image(point, (arb(d.tau), arb(d.v)), small, (-1,))
        for walls in ((), (-1, -1), (1,)):
            with pytest.raises(rattle.NotProvedError):
                images.enclose_image(point, (arb(d.tau), arb(d.v)), small, walls)
        with pytest.raises(rattle.NotProvedError):
            images.enclose_image(point, (arb(d.tau), arb(d.v)), arb_mat([[0.1, 0], [0, 0.5]]), (-1,))


def test_a_set_that_reaches_across_a_graze_has_no_image():
    """Beside Γ, where its middle misses Σ⁻: proved of so small a set that all of it does, by either program."""
    pi = search.ReturnMap(rattle.Gear(0.6, 0.1))
    v, high = 4.6, 4.7
    for _ in range(40):
        middle = (v + high) / 2
        misses = pi(np.array([0.6, middle]))[1] == 0
        v, high = (middle, high) if misses else (v, middle)
    v -= 1e-4
    claim = check.HorseshoeClaim.__new__(check.HorseshoeClaim)
    claim.delta, claim.epsilon, claim.beta = (shared.interval_of_text(x) for x in ("0.6", "0.1", "0.6"))
    with precision():
        point = ModelPoint(*(ball(Fraction(x)) for x in ("0.6", "0.1", "0.6")))
        for size, ok in ((1e-5, True), (1.5e-4, False), (1e-3, False)):
            claim.sets = [[shared.IV.mpf(x) for x in (0.6, v, 1e-9, 0, 0, size)]]
            for program in (
                lambda size=size: images.enclose_image(point, (arb(0.6), arb(v)), arb_mat([[1e-9, 0], [0, size]]), ()),
                lambda: claim.image(0, check.WHOLE, 0),
            ):
                try:
                    program()
                    assert ok
                except (rattle.NotProvedError, Refusal):
                    assert not ok


CHANGES = [
    {"entropy_per_impact": "0.3323"},
    {"entropy_per_period": "0.3323"},
    {"entropy_per_impact": "0"},
    {"entropy_per_impact": "-1"},
    {"loops": []},
    {"sets": []},
    {"model": "stiff"},
    {"theorem": "bifurcation"},
    {"format": 2},
    {"parameters": {"delta": "0.6", "epsilon": "0.1"}},
    {"parameters": {"delta": "0.6", "epsilon": "-0.1", "beta": "0.6"}},
]


@pytest.mark.parametrize("changes", CHANGES, ids=str)
def test_documents_that_claim_something_else_are_refused(stored, changes):
    with pytest.raises(Refusal):
        check.check(json.dumps({**stored["0.6"], **changes}))


def test_loops_are_told_apart_by_their_first_sets(stored):
    """A loop listed twice, or one whose first set overlaps another's, would count the same motions again."""
    document = stored["0.6"]
    with pytest.raises(Refusal, match="may meet"):
        check.check(json.dumps({**document, "loops": [*document["loops"], document["loops"][0]]}))
    with precision():
        one = sets_of(document)[0]
        prove.require_disjoint_sets([one], [moved(one, Fraction(3), Fraction(0))])
        for overlapping in (one, moved(one, Fraction(19, 10), Fraction(0)), moved(one, Fraction(1), Fraction(1))):
            with pytest.raises(rattle.NotProvedError, match="the first parallelograms of two loops may overlap"):
                prove.require_disjoint_sets([one], [overlapping])
        later = coverings.HSet((one.centre[0] + 1, one.centre[1]), one.unstable, one.stable)
        with pytest.raises(rattle.NotProvedError, match="the first parallelograms of two loops may overlap"):
            prove.require_disjoint_sets([one], [later])


def test_the_entropy_is_that_of_words_of_loops():
    """Loops of lengths 1 and 2 have the golden mean, two of length 1 the full shift; the bound is never too high."""
    with precision():
        for lengths, truth in (((1, 2), np.log((1 + 5**0.5) / 2)), ((1, 1), np.log(2)), ((5, 5, 5), np.log(3) / 5)):
            assert truth - 2e-4 < float(prove.entropy_lower_bound(lengths)) <= truth


def test_where_nothing_is_chaotic_nothing_is_proved():
    with pytest.raises(rattle.NotProvedError, match="no motion that seems chaotic was found"):
        prove.certify_chaos("0.6", "0.0615")
    with pytest.raises(rattle.ParameterError, match="positive"):
        prove.certify_chaos("0.6", "0")


@deep
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("delta", POINTS)
def test_the_finder_finds_one_whatever_motions_it_looks_at(monkeypatch, stored, delta, seed):
    monkeypatch.setattr(search, "SEED", seed)
    given = stored[delta]["parameters"]
    found = prove.certify_chaos(given["delta"], given["epsilon"], given["beta"])
    assert found.per_impact > 0.15
