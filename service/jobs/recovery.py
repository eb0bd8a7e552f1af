"""Recover before a service begins: it clears away the half-done work of an earlier one, and nothing else."""

from __future__ import annotations

import logging
from contextlib import suppress

from gear_rattle.service.database import Database
from gear_rattle.service.errors import ConflictError
from gear_rattle.service.jobs.directory import DataDirectory

log = logging.getLogger(__name__)


def recover(database: Database, directory: DataDirectory) -> None:
    """End deletions that were begun, sweep what killed writers left, and name what belongs to nobody.

    Surveys that were running are checked against their stores when the job manager resumes them.
    """
    entries = directory.entries()
    known = database.known({entry.survey_id for entry in entries})
    for entry in entries:
        if entry.survey_id not in known:
            log.warning("%s belongs to no survey of the job database; it is left alone", entry.name)
        elif entry.deletion:
            entry.remove()
            with suppress(ConflictError):  # a database from before the deletion: the survey is computed again
                database.delete(entry.survey_id)
        elif entry.temporary:
            entry.remove()
    for survey_id in database.being_deleted():
        directory.remove_store(survey_id)
        database.delete(survey_id)
    for survey_id, content_hash in database.running():
        directory.sweep_partial_files(survey_id, content_hash)
