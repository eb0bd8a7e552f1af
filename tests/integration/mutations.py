"""Protections of docs/reliability.md and docs/security.md: edits that take each out, and the test that must then fail.

`protections.py` takes them out one by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

WORKERS = "tests/integration/test_faults_workers.py"
SERVICE = "tests/integration/test_faults_service.py"
STORAGE = "tests/integration/test_faults_storage.py"
ALONE = "tests/integration/test_service_alone.py"
DIRECTORY = "tests/contracts/service/test_service_directory.py"
ENDS = "tests/integration/test_service_ends.py"
PROCESSES = "tests/integration/test_workers_processes.py"
INTRUDERS = "tests/integration/test_cluster_intruders.py"
METRICS = "tests/contracts/service/test_service_metrics.py"
DAMAGE = "tests/contracts/service/test_service_damage.py"
LOGIN = "tests/contracts/service/test_service_login.py"
REVOCATION = "tests/contracts/service/test_service_revocation.py"
ACCESS = "tests/contracts/service/test_service_access.py"
ORIGINS = "tests/contracts/service/test_service_origins.py"
PROBLEMS = "tests/contracts/service/test_service_problems.py"


@dataclass(frozen=True)
class Edit:
    """A replacement in one file; the file must contain `old` exactly once."""

    file: str
    old: str
    new: str

    def apply(self, root: Path) -> None:
        path = root / self.file
        text = path.read_text()
        if (times := text.count(self.old)) != 1:
            raise ValueError(f"{self.file}: {times} times, not once: {self.old}")
        path.write_text(text.replace(self.old, self.new))


@dataclass(frozen=True)
class Protection:
    """A protection as edits that take it out, and the test that must then fail."""

    name: str
    test: str
    edits: tuple[Edit, ...]


def _one(name: str, test: str, file: str, old: str, new: str) -> Protection:
    return Protection(name, test, (Edit(file, old, new),))


PROTECTIONS = (
    _one(
        "another process starts workers when the first is killed",
        f"{PROCESSES}::test_another_process_starts_them_again_when_that_process_is_killed",
        "workers/cluster/cluster.py",
        "        while not self._over.is_set():\n            self._run_nanny_process()\n",
        "        if True:\n            self._run_nanny_process()\n",
    ),
    _one(
        "workers have the environment of now",
        f"{PROCESSES}::test_they_have_the_environment_of_now",
        "rattle/numerics/processes.py",
        "{**os.environ, SAFE_PATH",
        "{SAFE_PATH",
    ),
    _one(
        "workers end with a parent that is killed",
        f"{PROCESSES}::test_they_end_with_their_parent_also_if_it_is_killed_and_the_next_start_tidies_up",
        "workers/cluster/nannies.py",
        '    threading.Thread(target=_end_with_parent, name="end-with-parent", daemon=True).start()\n',
        "",
    ),
    _one(
        "the next start removes what a killed process left",
        f"{PROCESSES}::test_they_end_with_their_parent_also_if_it_is_killed_and_the_next_start_tidies_up",
        "workers/cluster/scratch.py",
        "    _remove_abandoned_directories(root or tempfile.gettempdir())\n",
        "",
    ),
    _one(
        "workers import nothing from the working directory",
        f"{PROCESSES}::test_a_script_needs_no_guard_and_its_directory_hides_nothing",
        "rattle/numerics/processes.py",
        ' SAFE_PATH: "1",',
        "",
    ),
    _one(
        "processes of points import nothing from the working directory",
        f"{PROCESSES}::test_a_service_imports_nothing_from_the_working_directory",
        "rattle/numerics/processes.py",
        '    os.environ[SAFE_PATH] = "1"\n',
        '    os.environ.pop(SAFE_PATH, "")\n',
    ),
    _one(
        "a start of workers is given up",
        f"{ENDS}::test_a_service_that_starts_ends_by_itself_and_leaves_nothing",
        "workers/cluster/cluster.py",
        "if not self.started.is_set() and self._should_stop():",
        "if False:",
    ),
    _one(
        "a silent worker is replaced",
        f"{WORKERS}::test_a_frozen_worker_is_replaced",
        "workers/cluster/cluster.py",
        '"worker_ttl": SILENT_SECONDS',
        '"worker_ttl": 300',
    ),
    _one(
        "a late tile is repeated elsewhere",
        f"{WORKERS}::test_a_tile_of_a_frozen_worker_is_repeated_elsewhere",
        "workers/cluster/submission.py",
        "        if late:\n",
        "        if False:\n",
    ),
    _one(
        "a late tile is repeated again where no other is on its way",
        "tests/contracts/workers/test_workers_submission.py::test_a_result_that_waits_with_one_of_a_frozen_worker_is_not_waited_for",
        "workers/cluster/runner.py",
        "again=not waiting or not room",
        "again=not waiting",
    ),
    _one(
        "a tile that kills workers is computed apart",
        f"{WORKERS}::test_a_poison_cell_is_the_only_one_lost",
        "workers/cluster/submission.py",
        "        if task.work.isolated:\n",
        "        if True:\n",
    ),
    _one(
        "a tile that never ends is computed apart",
        f"{WORKERS}::test_a_cell_that_never_ends_is_the_only_one_lost",
        "workers/cluster/isolation.py",
        "        if first < tile.n_cells and child.returncode == -signal.SIGXCPU:\n",
        "        if False:\n",
    ),
    _one(
        "endless tiles are taken one at a time",
        "tests/contracts/workers/test_workers_submission.py::test_endless_tiles_are_taken_one_at_a_time",
        "workers/cluster/submission.py",
        "            self._next_end = now + RESTART_SECONDS\n",
        "",
    ),
    _one(
        "curves whose processes were being ended are traced again",
        f"{WORKERS}::test_curves_whose_processes_are_killed_are_traced_again",
        "workers/cluster/runner.py",
        "ATTEMPTS = 3\n",
        "ATTEMPTS = 1\n",
    ),
    _one(
        "a connection given back after the close is closed",
        "tests/contracts/service/test_service_database.py::test_a_connection_that_a_thread_gives_back_after_the_close_is_closed",
        "service/database/__init__.py",
        '        event.listen(self._reader, "checkin", _close_returned_connection)\n',
        "",
    ),
    _one(
        "a command does not take the compiler down while it computes",
        "tests/contracts/service/test_service_commands.py::test_a_command_whose_thread_still_computes_ends_without_taking_the_compiler_down",
        "service/cli.py",
        "    if any(thread.daemon for thread in threading.enumerate()):\n",
        "    if False:\n",
    ),
    _one(
        "a page that is closed ends at once",
        "tests/contracts/service/test_service_pages.py::test_a_page_ends_with_its_browser_or_when_it_is_swept",
        "service/explorer/page/mount.py",
        "            if code in LEFT_CODES:\n",
        "            if False:\n",
    ),
    _one(
        "a tile apart goes on after the cell that killed it",
        f"{WORKERS}::test_a_poison_cell_is_the_only_one_lost",
        "workers/cluster/isolation.py",
        '({_describe_process_death(child.returncode)})"\n                first, deaths = first + 1, 0\n',
        '({_describe_process_death(child.returncode)})"\n                first, deaths = first, 0\n',
    ),
    _one(
        "a cell that raises fails alone",
        f"{WORKERS}::test_a_poison_cell_is_the_only_one_lost",
        "workers/survey/tiles.py",
        "        except Exception:  # the model failed in some cell",
        "        except MemoryError:  # the model failed in some cell",
    ),
    _one(
        "processes of unwanted tiles are ended",
        f"{WORKERS}::test_unwanted_tiles_end_at_once",
        "workers/cluster/submission.py",
        "        end_tasks(self._client, futures)\n",
        "        self._client.cancel(futures)\n",
    ),
    _one(
        "a dismissal ends processes",
        f"{SERVICE}::test_a_dismissal_ends_the_work_and_a_deletion_the_store",
        "service/jobs/manager.py",
        "(self._is_interrupted, self._dismissed.is_set, must_pause)",
        "(self._is_interrupted, lambda: False, must_pause)",
    ),
    Protection(
        "a lost scheduler is not the survey's fault",
        "tests/integration/test_faults_scheduler.py",
        (
            Edit(
                "service/jobs/manager.py",
                "except (ClusterLostError, CommClosedError, SQLAlchemyError,",
                "except (SQLAlchemyError,",
            ),
            Edit("service/jobs/manager.py", 'if client.status != "running":  # a lost', "if False:  # a lost"),
        ),
    ),
    Protection(
        "cancelled by nobody, or not answering, the scheduler is gone",
        "tests/integration/test_workers_cluster.py::test_a_dead_scheduler_is_told_from_a_stop",
        (
            Edit(
                "workers/cluster/in_flight.py",
                "            raise self.lost_scheduler_error() from error\n        raise error",
                "            return None\n        raise error",
            ),
            Edit(
                "workers/cluster/in_flight.py",
                "            raise self.lost_scheduler_error() from error\n        now",
                "            return 0\n        now",
            ),
        ),
    ),
    _one(
        "a store appears whole",
        f"{SERVICE}::test_killed_at_every_instant",
        "workers/storage/location.py",
        "            os.rename(sibling, self.path)\n",
        "            for key, content in template.items():\n"
        "                (self.path / key).parent.mkdir(parents=True, exist_ok=True)\n"
        "                (self.path / key).write_bytes(content)\n",
    ),
    _one(
        "an interrupted survey is taken up again",
        f"{SERVICE}::test_killed_at_every_instant",
        "service/database/survey_rows.py",
        "remaining_cells).where(IS_ACTIVE).order_by",
        "remaining_cells).where(JobRow.state == State.ACCEPTED).order_by",
    ),
    _one(
        "a tile counts only if the database has its row",
        f"{SERVICE}::test_killed_at_every_instant",
        "service/jobs/manager.py",
        "self._database.recorded_tile_indices(job.id) & tiles_done(request, path, self._is_interrupted)",
        "tiles_done(request, path, self._is_interrupted)",
    ),
    _one(
        "a tile counts only if the store has its numbers",
        f"{SERVICE}::test_damage_is_repaired_on_request",
        "service/jobs/manager.py",
        "self._database.recorded_tile_indices(job.id) & tiles_done(request, path, self._is_interrupted)",
        "self._database.recorded_tile_indices(job.id)",
    ),
    _one(
        "nothing is computed by the manager",
        f"{SERVICE}::test_a_survey_that_is_being_prepared_can_be_dismissed",
        "service/jobs/manager.py",
        "create_store(request, path, compute_template)",
        "create_store(request, path)",
    ),
    _one(
        "a dismissal ends the process that prepares a survey",
        f"{SERVICE}::test_a_survey_that_is_being_prepared_can_be_dismissed",
        "workers/cluster/runner.py",
        "        end_tasks(client, [future])\n",
        "",
    ),
    _one(
        "a join that is given up has ended before another begins",
        "tests/integration/test_workers_cluster.py::test_a_task_that_began_while_it_was_given_up_has_ended",
        "workers/cluster/cluster.py",
        "    while quiet < IDLE_CHECKS:\n",
        "    while False:\n",
    ),
    _one(
        "what enters a block goes on into the next ones",
        "tests/contracts/workers/test_workers_families.py::test_blocks_do_not_show",
        "workers/families/join.py",
        "            if not again:\n",
        "            if True:\n",
    ),
    _one(
        "a tile of which the move was interrupted is not moved on",
        "tests/contracts/workers/test_workers_families.py"
        "::test_a_tile_that_was_being_moved_when_its_worker_died_is_moved_all_the_same",
        "workers/families/move.py",
        "    if values is None:\n",
        "    if False:\n",
    ),
    _one(
        "a damaged root is mended",
        f"{SERVICE}::test_a_damaged_root_is_mended_on_request",
        "workers/storage/integrity.py",
        "    lost = [ROOT] if read_undamaged_root(place, manifest) is None else []\n",
        "    lost = list[str]()\n",
    ),
    _one(
        "a lost chunk of a completed survey is damage",
        "tests/contracts/workers/test_workers_integrity.py"
        "::test_a_tile_that_the_manifest_lacks_is_lost_once_the_survey_was_completed",
        "workers/storage/integrity.py",
        "    if completed:\n",
        "    if False:\n",
    ),
    _one(
        "an error of the service is answered where it is counted",
        "tests/contracts/service/test_service_metrics.py::test_errors_of_the_service_count_as_such",
        "service/web/problems.py",
        "            if not begun:\n",
        "            if False:\n",
    ),
    Protection(
        "published last",
        f"{SERVICE}::test_killed_at_every_instant",
        (
            Edit("service/jobs/manager.py", "            finish_store(path)\n", "            pass\n"),
            Edit(
                "service/jobs/manager.py",
                "survey_id, State.SUCCESSFUL)\n",
                "survey_id, State.SUCCESSFUL)\n                finish_store(path)\n",
            ),
        ),
    ),
    _one(
        "a run says that the disk is full",
        f"{STORAGE}::test_a_run_on_a_full_disk_is_resumed",
        "workers/kinds.py",
        "    if isinstance(error, OSError):\n",
        "    if False:\n",
    ),
    _one(
        "a service waits for its store",
        f"{STORAGE}::test_a_service_waits_for_a_full_disk",
        "service/jobs/manager.py",
        "        except StorageError as error:\n            self",
        "        except ZeroDivisionError as error:\n            self",
    ),
    _one(
        "every chunk has a checksum",
        f"{STORAGE}::test_every_byte_of_a_chunk_is_under_its_checksum",
        "workers/survey/template.py",
        "CODECS = (ZstdCodec(level=0), Crc32cCodec())",
        "CODECS = (ZstdCodec(level=0),)",
    ),
    _one(
        "every chunk has a file",
        f"{STORAGE}::test_damaged_and_lost_chunks_are_found_and_computed_again",
        "workers/survey/template.py",
        '{"write_empty_chunks": True}',
        '{"write_empty_chunks": False}',
    ),
    _one(
        "what the database does not own is left alone",
        "tests/contracts/service/test_service_recovery.py::test_only_what_the_database_owns_is_swept",
        "service/jobs/recovery.py",
        "        if entry.survey_id not in known:\n",
        "        if entry.survey_id not in known:\n            entry.remove()\n",
    ),
    _one(
        "a deletion is noted before it begins",
        "tests/contracts/service/test_service_recovery.py::test_a_deletion_is_noted_before_it_begins",
        "service/jobs/manager.py",
        "            self._database.begin_deletion(survey_id)",
        "            pass",
    ),
    _one(
        "a deletion that was begun is ended",
        "tests/contracts/service/test_service_recovery.py::test_a_deletion_that_was_begun_is_ended",
        "service/jobs/recovery.py",
        "        directory.remove_store(survey_id)\n        database.delete(survey_id)\n",
        "        pass\n",
    ),
    _one(
        "one service on one database",
        f"{ALONE}::test_a_second_service_is_refused_by_data_directory_and_by_database",
        "service/database/database_lock.py",
        "self._lock.acquire()",
        "pass",
    ),
    _one(
        "one server on one data directory",
        f"{ALONE}::test_several_workers_of_uvicorn_are_refused",
        "service/jobs/directory.py",
        "lock.acquire()",
        "pass",
    ),
    _one(
        "what is open ends with the service",
        f"{ENDS}::test_a_busy_service_ends_by_itself_with_its_tiles",
        "service/web/server.py",
        "            loop.call_soon_threadsafe(app.state.front.end)\n",
        "",
    ),
    _one(
        "what does not end is killed in time",
        f"{ENDS}::test_what_cannot_be_ended_is_killed_in_time",
        "service/web/server.py",
        "            deadline.start()\n",
        "",
    ),
    _one(
        "nothing is accepted while the data directory is away",
        f"{DIRECTORY}::test_while_it_is_away_nothing_is_accepted_and_nothing_written",
        "service/operations/surveys.py",
        "    front.directory.require_present()\n",
        "",
    ),
    _one(
        "a job database that is away is left alone",
        f"{DIRECTORY}::test_while_it_is_away_nothing_is_accepted_and_nothing_written",
        "service/jobs/opening.py",
        "directory.database_url, directory.require_present)",
        "directory.database_url, None)",
    ),
    _one(
        "stores that are away are not read as empty",
        f"{DIRECTORY}::test_while_it_is_away_nothing_is_accepted_and_nothing_written",
        "service/jobs/directory.py",
        "        self.require_present()\n",
        "",
    ),
    _one(
        "a store that is away is not deleted",
        f"{DIRECTORY}::test_an_ended_survey_is_not_deleted_where_it_is_not",
        "service/jobs/manager.py",
        "            self._directory.require_present()\n            self._database",
        "            self._database",
    ),
    _one(
        "a data directory that is away is not the survey's fault",
        f"{DIRECTORY}::test_a_survey_waits_for_its_directory",
        "service/jobs/manager.py",
        "            with self._prefer_missing_directory_error():\n",
        "            if True:\n",
    ),
    _one(
        "a job database that was replaced is opened anew",
        f"{DIRECTORY}::test_what_comes_back_as_another_device_is_opened_anew",
        "service/database/engine.py",
        "raise InvalidatePoolError(FILE_REPLACED)",
        "pass",
    ),
    _one(
        "a database elsewhere knows the data directory",
        f"{DIRECTORY}::test_a_database_elsewhere_knows_the_directory",
        "service/jobs/opening.py",
        "directory.check_identity(database.directory_identity())",
        "directory.check_identity()",
    ),
    _one(
        "a cluster that starts is given up",
        f"{ENDS}::test_a_service_that_starts_ends_by_itself_and_leaves_nothing",
        "service/jobs/manager.py",
        "self._cluster(self._stopping.is_set)",
        "self._cluster(lambda: False)",
    ),
    _one(
        "a signal that comes early is not forgotten",
        f"{ENDS}::test_a_service_that_starts_ends_by_itself_and_leaves_nothing",
        "service/web/server.py",
        "        if asked_to_stop.is_set():\n",
        "        if False:\n",
    ),
    _one(
        "semaphores of what is killed are removed",
        f"{ENDS}::test_what_cannot_be_ended_is_killed_in_time",
        "service/web/server.py",
        '            if TRACKER not in " ".join(child.cmdline()):\n',
        "            if True:\n",
    ),
    _one(
        "an address is taken before anything starts",
        f"{ENDS}::test_a_port_that_is_taken_is_told_before_anything_starts",
        "service/web/server.py",
        "    sockets = bind_sockets(settings.host, settings.port)\n",
        "    sockets = []\n",
    ),
    _one(
        "an embedded cluster asks for its certificate",
        f"{INTRUDERS}::test_nothing_is_executed_without_tls",
        "workers/cluster/cluster.py",
        '"tls://", "security": Security.temporary()',
        '"tcp://", "security": Security(require_encryption=False)',
    ),
    _one(
        "an embedded cluster has no pages",
        f"{INTRUDERS}::test_a_service_listens_for_http_and_for_its_own_certificate_only",
        "workers/cluster/cluster.py",
        "dask.config.set({**FEW_DIAGNOSTICS, **NO_PAGES,",
        "dask.config.set({**FEW_DIAGNOSTICS,",
    ),
    _one(
        "modules are looked for in private places",
        f"{INTRUDERS}::test_modules_are_taken_from_no_place_of_others",
        "workers/cluster/cluster.py",
        '"temporary-directory": scratch}',
        '"temporary-directory": None}',
    ),
    _one(
        "nobody forges a line of the log",
        f"{METRICS}::test_nobody_forges_a_line_of_text",
        "service/observability/logs.py",
        "    if text.isprintable():\n",
        "    if True:\n",
    ),
    _one(
        "a traceback's message stays in its line",
        f"{METRICS}::test_nobody_forges_a_line_of_json",
        "service/observability/logs.py",
        'return [f"  {escape_unprintable(line)}" for line in lines]',
        "return lines",
    ),
    _one(
        "libraries' handlers write as ours",
        f"{METRICS}::test_libraries_with_handlers_of_their_own_write_like_everybody",
        "service/observability/logs.py",
        "                handler.setFormatter(ours.formatter)\n",
        "",
    ),
    _one(
        "a damaged row hides no other",
        f"{DAMAGE}::test_a_damaged_request_is_shown_as_failed_and_can_be_deleted",
        "service/database/engine.py",
        "    except (ValueError, TypeError, RecursionError):\n",
        "    except ZeroDivisionError:\n",
    ),
    _one(
        "a damaged row holds up no other",
        f"{DAMAGE}::test_the_surveys_behind_a_damaged_one_run",
        "service/database/engine.py",
        "    except (ValueError, TypeError, RecursionError):\n",
        "    except ZeroDivisionError:\n",
    ),
    _one(
        "a lost chunk is no fill value",
        f"{DAMAGE}::test_a_chunk_that_was_computed_and_is_lost_is_no_fill_value",
        "service/routes/store.py",
        "if not await run_in_threadpool(is_expected_file, front, survey_id, key):",
        "if True:",
    ),
    _one(
        "what cannot be read is a problem of the survey",
        f"{DAMAGE}::test_links_in_a_circle_are_a_problem_of_the_survey",
        "workers/errors.py",
        "    except Exception as error:\n",
        "    except ZeroDivisionError as error:\n",
    ),
    _one(
        "what cannot be drawn is said",
        f"{DAMAGE}::test_axes_to_the_end_of_double_precision_are_drawn_or_refused",
        "workers/pictures/maps.py",
        "    if reach > FARTHEST_DRAWN:\n",
        "    if False:\n",
    ),
    _one(
        "a form of many fields is refused",
        f"{LOGIN}::test_a_form_of_many_fields_is_refused_in_words",
        "service/access/login.py",
        "    except ValueError:\n        raise HTTPException(422",
        "    except ZeroDivisionError:\n        raise HTTPException(422",
    ),
    _one(
        "a revoked key's streams end",
        f"{REVOCATION}::test_streams_end_when_their_key_is_revoked_and_others_go_on",
        "service/access/revocation.py",
        "                    scope.cancel()\n",
        "                    pass\n",
    ),
    _one(
        "a revoked key's pages end",
        f"{REVOCATION}::test_the_websocket_of_a_page_ends_too",
        "service/explorer/page/mount.py",
        '        with scope["app"].state.front.revocations.cancel_when_revoked(caller) as visit:\n',
        '        with scope["app"].state.front.revocations.cancel_when_revoked(None) as visit:\n',
    ),
    _one(
        "one question is for all that is open",
        f"{REVOCATION}::test_one_question_is_for_all_of_them_and_none_for_none",
        "service/access/revocation.py",
        "            if not self._open:\n",
        "            if False:\n",
    ),
    _one(
        "what waits is not sent to who may no longer be here",
        "tests/contracts/explorer/test_explorer_socket.py::test_what_waits_is_not_sent_to_who_may_no_longer_be_here",
        "service/explorer/page/whole_messages.py",
        "        sender.cancel()  #",
        "        pass  #",
    ),
    _one(
        "a session ends by signing out",
        f"{LOGIN}::test_the_cookie_is_a_session_of_its_own_and_not_the_key",
        "service/access/login.py",
        "await run_in_threadpool(request.app.state.front.database.end_session, hash_secret(session))",
        "pass",
    ),
    _one(
        "a session ends with its time and its key",
        f"{LOGIN}::test_a_session_ends_with_its_time_and_with_its_key",
        "service/database/keys.py",
        "    return joined.where(SessionRow.expires > timestamp(), KeyRow.revoked.is_(None))\n",
        "    return joined.where(KeyRow.revoked.is_(None))\n",
    ),
    _one(
        "answered idempotency keys are bounded",
        "tests/contracts/service/test_service_database.py::test_the_latest_answers_are_remembered",
        "service/database/identity.py",
        ".limit(MOST_REPEATED_KEYS)",
        ".limit(10**6)",
    ),
    _one(
        "any tag is known where there is one",
        "tests/contracts/service/test_service_conditional.py::test_any_tag_is_that_of_whatever_is_there",
        "service/web/conditional.py",
        '!= "*":\n            await self.app',
        '!= "**":\n            await self.app',
    ),
    _one(
        "a compressed body is refused",
        f"{ACCESS}::test_a_compressed_body_is_refused_in_words",
        "service/access/middleware.py",
        "                _require_uncompressed_body(headers)\n",
        "",
    ),
    _one(
        "a browser that leaves is counted out",
        "tests/contracts/explorer/test_explorer_socket.py::test_a_browser_that_leaves_is_counted_out_once_and_its_last_message_is_not_handled_again",
        "service/explorer/page/whole_messages.py",
        "        if is_told:\n",
        "        if True:\n",
    ),
    _one(
        "no change is sent while a browser takes its document",
        "tests/contracts/explorer/test_explorer_socket.py::test_changes_wait_while_a_browser_takes_its_document",
        "service/explorer/common/changes.py",
        "        if document in _waiting:\n",
        "        if False:\n",
    ),
    _one(
        "a page does not show another one's",
        "tests/contracts/service/test_service_pages.py::test_a_page_is_nobody_else_s_whatever_it_is_asked_by",
        "service/explorer/page/pages.py",
        "if pair[0] not in NAMING]\n        headers",
        "]\n        headers",
    ),
    _one(
        "a request from another machine needs a key",
        f"{ORIGINS}::test_on_loopback_no_key_is_asked_but_of_those_who_are_not_there",
        "service/access/middleware.py",
        "(self._settings.insecure or is_local_request(scope, headers))",
        "True",
    ),
    _one(
        "what a proxy forwards is not local",
        f"{ORIGINS}::test_a_proxy_on_loopback_does_not_open_the_door",
        "service/access/origins.py",
        "address.is_loopback and not forwarded",
        "address.is_loopback",
    ),
    _one(
        "a name that was pointed here is refused",
        f"{ORIGINS}::test_a_name_that_was_pointed_here_is_refused",
        "service/access/middleware.py",
        "            require_own_host(headers, self._settings.host, self._settings.allowed_hosts)\n",
        "",
    ),
    _one(
        "a page of another site does not write",
        f"{ORIGINS}::test_a_page_of_another_site_cannot_write",
        "service/access/middleware.py",
        "                require_same_origin(headers)\n",
        "",
    ),
    _one(
        "pages load nothing from other hosts",
        f"{ORIGINS}::test_no_page_of_another_site_is_allowed_to_read",
        "service/access/middleware.py",
        '    "Content-Security-Policy": CONTENT_SECURITY,\n',
        "",
    ),
    _one(
        "a key that reads does not write",
        f"{ACCESS}::test_reading_does_not_allow_writing",
        "service/access/middleware.py",
        "        if not caller.has_scope(wanted):\n",
        "        if False:\n",
    ),
    _one(
        "a survey is removed by its owner alone",
        f"{ACCESS}::test_only_the_key_that_submitted_a_survey_removes_it",
        "service/access/keys.py",
        "return self.key is None or job.owner == self.key.id",
        "return True",
    ),
    _one(
        "a quota counts running surveys",
        f"{ACCESS}::test_many_requests_at_once_do_not_pass_a_quota",
        "service/database/survey_rows.py",
        "if key.max_running is not None and running >= key.max_running:",
        "if False:",
    ),
    _one(
        "a quota counts cells",
        f"{ACCESS}::test_many_requests_at_once_do_not_pass_a_quota",
        "service/database/survey_rows.py",
        "if key.max_cells is not None and kept + n_cells > key.max_cells:",
        "if False:",
    ),
    _one(
        "a large body is refused",
        f"{PROBLEMS}::test_a_large_body_is_refused",
        "service/app.py",
        "    app.add_middleware(RequestBodyLimitMiddleware, max_body_size=settings.max_body_bytes)\n",
        "",
    ),
)
