"""The exceptions of surveys, all derived from SurveyError. The public package `gear_rattle` exports them."""

import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from rattle import RattleError
from rattle.errors import did_you_mean

LONGEST_NAME = 80  # a message quotes at most this many characters of a name


class SurveyError(RattleError):
    """A survey or population cannot be requested, stored, run, opened or drawn; the message says what to do."""

    __module__ = "gear_rattle"
    code = "survey_error"


class StoppedError(SurveyError):
    """An operation was stopped on request. The store is undamaged."""

    __module__ = "gear_rattle"
    code = "stopped"


class ClusterLostError(SurveyError):
    """The cluster was lost during a run. The store is undamaged, and the same run on another cluster continues it."""

    __module__ = "gear_rattle"
    code = "cluster_lost"


class StorageError(SurveyError):
    """A store cannot be used now: its disk is full, read-only or missing, its bucket does not answer, or it lost files.

    The files of the store that still exist are undamaged, so the run can be resumed when the cause has passed.
    """

    __module__ = "gear_rattle"
    code = "storage_unavailable"


class DamageError(SurveyError):
    """A computed part of a store cannot be read, because it is damaged or gone. It can be computed again."""

    __module__ = "gear_rattle"
    code = "store_damaged"


def missing_map_message(variable: str, maps: Iterable[str]) -> str:
    """Return the message for a map that does not exist. The message suggests a similar name, or lists all maps."""
    known = sorted(maps)
    meant = did_you_mean(variable, known)
    return f"there is no map {variable[:LONGEST_NAME]!r}{meant or ': there are ' + ', '.join(known)}"


@contextmanager
def report_damage(what: str) -> Iterator[None]:
    """Turn errors of reading in this context into DamageError. what: the words for the data in the message."""
    try:
        yield
    except (RattleError, MemoryError):
        raise
    except FileNotFoundError as error:
        raise DamageError(
            f"{what} cannot be read because its store is gone ({error}): restore the store, or compute it again with "
            "the command that made it or, in a service, with POST /v1/surveys/ID/verify or /v1/populations/ID/verify"
        ) from error
    except Exception as error:
        raise DamageError(
            f"{what} cannot be read ({str(error) or type(error).__name__}): if the store is damaged, repair the store "
            "with the command that made it or, in a service, with POST /v1/surveys/ID/verify or "
            "/v1/populations/ID/verify"
        ) from error


#: Error numbers of failures that may end by themselves or by the user's action, so that the survey can continue.
_TRANSIENT_ERRORS = {
    errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.ESTALE, errno.ENOMEM, errno.EMFILE, errno.ENFILE,
}  # fmt: skip


def storage_error(what: str, error: OSError) -> SurveyError:
    """Return the exception for a failed write: a StorageError if the cause may pass, else a SurveyError.

    what: the beginning of the message, which names the file and the failure.

    Returns
    -------
    SurveyError
        Its message says what to do.
    """
    if error.errno in _TRANSIENT_ERRORS:
        return StorageError(f"{what} ({error}): free space or make the store writable, and try again")
    return SurveyError(f"{what} ({error}): make the path writable, or choose another path")
