"""Exceptions of a survey, under one base; the public package `gear_rattle` exports them."""

import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from rattle import RattleError
from rattle.errors import did_you_mean

LONGEST = 80  # the most characters of a name in a message


class SurveyError(RattleError):
    """A survey cannot be requested, stored, run, opened or drawn; the message says what to do."""

    __module__ = "gear_rattle"
    code = "survey_error"


class StoppedError(SurveyError):
    """The operation was stopped on request. The survey is whole."""

    __module__ = "gear_rattle"
    code = "stopped"


class ClusterLostError(SurveyError):
    """The cluster went away during a run. The survey is whole: the same run on another cluster continues it."""

    __module__ = "gear_rattle"
    code = "cluster_lost"


class StorageError(SurveyError):
    """The disk is full, read-only or away. The survey is whole: it continues once the store is writable again."""

    __module__ = "gear_rattle"
    code = "storage_unavailable"


class DamageError(SurveyError):
    """A computed part of a survey cannot be read; it can be computed again."""

    __module__ = "gear_rattle"
    code = "store_damaged"


def no_map(variable: str, maps: Iterable[str]) -> str:
    """Return the message for a missing map: it suggests the one that was probably meant, or lists all."""
    known = sorted(maps)
    meant = did_you_mean(variable, known)
    return f"there is no map {variable[:LONGEST]!r}{meant or ': there are ' + ', '.join(known)}"


@contextmanager
def reading(what: str) -> Iterator[None]:
    """Turn errors of file systems, object stores and codecs during a read into DamageError."""
    try:
        yield
    except (RattleError, MemoryError):
        raise
    except FileNotFoundError as error:
        raise DamageError(
            f"{what} cannot be read because its store is gone ({error}): restore it, or compute it again with the "
            "command that made it or with POST /v1/surveys/ID/verify"
        ) from error
    except Exception as error:
        raise DamageError(
            f"{what} cannot be read ({str(error) or type(error).__name__}): if its store is damaged, repair it with "
            "the command that made it or with POST /v1/surveys/ID/verify"
        ) from error


#: Causes that may pass while the survey itself stays as it is.
_PASSING = {
    errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.ESTALE, errno.ENOMEM, errno.EMFILE, errno.ENFILE,
}  # fmt: skip


def storage_error(what: str, error: OSError) -> SurveyError:
    """Return the exception for a write that the system refused: a StorageError if the cause may pass."""
    if error.errno in _PASSING:
        return StorageError(f"{what} ({error}): free space or make it writable, and the same survey continues")
    return SurveyError(f"{what} ({error}): make it writable, or choose another path")
