"""Each mutation of the finder's signs and bounds is caught by a test of proofs, as tests/references/proof_mutations.py
found: that it still applies is looked at every day, that it is caught before a release.
"""

import json

import proof_mutations
import pytest
from depth import deep

CAUGHT = json.loads(proof_mutations.RESULT.read_text())


@pytest.mark.parametrize("name", proof_mutations.MUTATIONS)
def test_a_mutation_is_one_of_the_finder_of_today_and_was_caught(name):
    mutant = proof_mutations.Mutant(*proof_mutations.MUTATIONS[name])
    compile(mutant.text, mutant.path, "exec")
    assert CAUGHT[name]


def test_there_are_many():
    assert len(CAUGHT) == len(proof_mutations.MUTATIONS) > 20


@deep
@pytest.mark.parametrize("name", proof_mutations.MUTATIONS)
def test_a_mutation_is_caught(name):
    assert proof_mutations.caught_by(name)
