"""No false proof: motions moved, mislabelled, elsewhere in the plane, virtual, or unstable and called attracting."""

import json

import false_claims
import pytest
from depth import either

import rattle
from rattle.proof.check import Refusal, check


@pytest.mark.parametrize("kind", false_claims.KINDS)
@pytest.mark.parametrize("stiff", [False, True], ids=["impacting", "stiff"])
def test_false_claims_are_refused_by_finder_and_checker(kind, stiff):
    given = false_claims.claims(kind, 27, stiff)
    for _ in range(either(4 if stiff else 12, 300)):
        finder, checker = false_claims.answers(next(given))
        assert finder
        assert checker
        if kind == "virtual":
            assert any(word in finder for word in ("touch", "inside the walls"))
            assert any(word in checker for word in ("before another event", "side of its walls"))


@pytest.fixture(scope="module")
def certificate():
    gear = rattle.Gear(0.6, 0.089)
    d = gear.orbits()[2]
    return rattle.certify(gear.orbit(d.tau, d.v)).document()


def altered(certificate, **changes):
    return json.dumps({**certificate, **changes})


def test_the_certificate_that_is_altered_here_is_proved(certificate):
    assert check(json.dumps(certificate)).startswith("P(1, 1, 0), attracting, at delta = 0.59999")


HERE = {"delta": "0.6", "epsilon": "0.089", "beta": "0.6"}
CHANGES = [
    *({"format": x} for x in (2, "1", None)),
    *({"model": x} for x in ("other", "stiff", None)),
    *({"label": x} for x in ([1, 1, 1], [1, 2, 0], [1.5, 1, 0], [0, 1, 0], [-1, 1, 0], [], None)),
    *({"walls": x} for x in ([], [2], [-1], [True], [1, 1], None)),
    *({"times": x} for x in ([], ["0.9"], [0.9], ["nan"], ["1e400000000"], ["9" * 5000], None)),
    *({"speeds": x} for x in (["-3.77"], ["inf"], ["3.77", "3.77"])),
    *({"time_radius": x} for x in ("0", "-0.1", "1", 0.1)),
    *({"speed_radius": x} for x in ("0.0", "1/0")),
    *({"trace": x} for x in (["0", "0.001"], ["2", "1"], ["1"])),
    *({"determinant": x} for x in (["0.5488", "0.5488"], ["0.6", "0.7"])),
    *({"multipliers": x} for x in ([], [["-9", "9"]] * 3, [["-9", "9"]] * 5, [["9", "-9"]] * 4)),
    *({"verdict": x} for x in ("saddle", "proved", None, ["attracting"])),
    *({"parameters": x} for x in ({}, {**HERE, "kappa": "1"}, {**HERE, "delta": "-0.6"}, {**HERE, "beta": "0"})),
]


@pytest.mark.parametrize("changes", CHANGES, ids=str)
def test_documents_that_claim_something_else_are_refused(certificate, changes):
    with pytest.raises(Refusal):
        check(altered(certificate, **changes))


@pytest.mark.parametrize("text", ["", "{", "[]", "null", "3", '"text"', "[" * 5000])
def test_what_is_no_certificate_is_refused(text):
    with pytest.raises(Refusal):
        check(text)


def test_each_number_of_a_certificate_is_looked_at(certificate):
    """A claim that is a little narrower than what is true, at either end of each enclosure."""
    for name in ("trace", "determinant"):
        low, high = certificate[name]
        for wrong in ([high, high], [low, low]):
            with pytest.raises(Refusal, match="not proved to be between"):
                check(altered(certificate, **{name: wrong}))
    for i, (low, high) in enumerate(certificate["multipliers"]):
        for wrong in ([high, "9"], ["-9", low]):
            changed = [wrong if j == i else ends for j, ends in enumerate(certificate["multipliers"])]
            with pytest.raises(Refusal, match="not proved to be between"):
                check(altered(certificate, multipliers=changed))
