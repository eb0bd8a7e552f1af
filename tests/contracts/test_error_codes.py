"""Every error that a user meets has a stable code, which programs match; the sentences are for people."""

import re

import pytest
from service_support import CODE

import gear_rattle.service.errors
import gear_rattle.workers.errors
from gear_rattle.service.web.problems import ADVICE, CODES
from rattle import RattleError
from rattle.models import CapabilityError


def kinds(base: type[RattleError]) -> list[type[RattleError]]:
    """A class of errors and all classes below it."""
    return [base, *(each for below in base.__subclasses__() for each in kinds(below))]


ALL = sorted(set(kinds(RattleError)), key=lambda kind: kind.__name__)


@pytest.mark.parametrize("kind", ALL)
def test_each_class_of_errors_has_a_code_of_its_own(kind: type[RattleError]) -> None:
    assert re.fullmatch(CODE, kind.code)
    assert "code" in vars(kind)


def test_no_two_classes_have_one_code() -> None:
    codes = [kind.code for kind in ALL]
    assert len(set(codes)) == len(codes)
    assert CapabilityError in ALL
    assert gear_rattle.service.errors.ServiceError in ALL
    assert gear_rattle.workers.errors.SurveyError in ALL


def test_answers_of_libraries_have_codes_too() -> None:
    assert set(ADVICE) <= set(CODES)
    assert all(re.fullmatch(CODE, code) for code in CODES.values())
