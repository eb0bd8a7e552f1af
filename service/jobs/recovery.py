"""Clean up the unfinished work of an earlier service before the new service begins."""

from __future__ import annotations

import logging
from contextlib import suppress

from gear_rattle.service.database import Database
from gear_rattle.service.errors import ConflictError
from gear_rattle.service.jobs.directory import DataDirectory

log = logging.getLogger(__name__)


def clean_up_unfinished_work(database: Database, directory: DataDirectory) -> None:
    """Complete deletions, and remove unfinished stores and partial files that killed processes left.

    Stores that belong to no survey or population of the job database are only reported in the log.
    The job manager checks running surveys against their stores when it resumes them.
    """
    entries = directory.entries()
    known = database.existing_ids({entry.survey_id for entry in entries})
    for entry in entries:
        if entry.survey_id not in known:
            log.warning("%s belongs to no survey of the job database; it is left alone", entry.name)
        elif entry.is_deletion:
            entry.remove()
            # If the database is a backup, this survey may be active in it. An active survey is not deleted, but
            # computed again.
            with suppress(ConflictError):
                database.delete(entry.survey_id)
        elif entry.is_temporary:
            entry.remove()
    for survey_id in database.surveys_being_deleted():
        directory.remove_store(survey_id)
        database.delete(survey_id)
    for survey_id, content_hash in database.running_surveys():
        directory.remove_partial_files(survey_id, content_hash)
