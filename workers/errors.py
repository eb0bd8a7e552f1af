"""Exceptions of a survey, under one base. The classes are names of `gear_rattle`, and say so."""

import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from rattle import RattleError
from rattle.errors import did_you_mean

LONGEST = 80  # characters of a name in a message


class SurveyError(RattleError):
    """A survey that cannot be asked for, stored, run, opened or drawn; the message says what to do."""

    __module__ = "gear_rattle"
    code = "survey_error"


class StoppedError(SurveyError):
    """The operation was stopped on request. The survey is whole."""

    __module__ = "gear_rattle"
    code = "stopped"


class ClusterLostError(SurveyError):
    """The cluster went away during a run. The survey is whole: another cluster resumes it."""

    __module__ = "gear_rattle"
    code = "cluster_lost"


class StorageError(SurveyError):
    """The disk is full, read-only or away. The survey is whole: it goes on once the store can be written again."""

    __module__ = "gear_rattle"
    code = "storage_unavailable"


class DamageError(SurveyError):
    """Something of a survey that was computed cannot be read; it can be computed again."""

    __module__ = "gear_rattle"
    code = "store_damaged"


def no_map(variable: str, maps: Iterable[str]) -> str:
    """Return the sentence for a map that is not there: the one that was meant, or all that there are."""
    known = sorted(maps)
    meant = did_you_mean(variable, known)
    return f"there is no map {variable[:LONGEST]!r}{meant or ': there are ' + ', '.join(known)}"


@contextmanager
def reading(what: str) -> Iterator[None]:
    """Turn whatever file systems, object stores and codecs raise while numbers are read into DamageError."""
    try:
        yield
    except (RattleError, MemoryError):
        raise
    except FileNotFoundError as error:
        raise DamageError(
            f"{what} cannot be read, for its store is gone ({error}): bring it back, or the command that made it, or "
            "POST /v1/surveys/ID/verify, computes it anew"
        ) from error
    except Exception as error:
        raise DamageError(
            f"{what} cannot be read ({str(error) or type(error).__name__}): if its store is damaged, the command that "
            "made it, or POST /v1/surveys/ID/verify, computes again what is"
        ) from error


#: What may pass without anybody touching the survey itself.
_PASSING = {
    errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.ESTALE, errno.ENOMEM, errno.EMFILE, errno.ENFILE,
}  # fmt: skip


def storage_error(what: str, error: OSError) -> SurveyError:
    """Return the exception for a write that the system refused: a StorageError if that may pass."""
    if error.errno in _PASSING:
        return StorageError(f"{what} ({error}): make room or make it writable, and the same survey goes on")
    return SurveyError(f"{what} ({error}): make it writable, or choose a path that is")
