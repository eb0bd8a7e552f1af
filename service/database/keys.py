"""The API keys in the job database. Only their hashes are stored; keys are revoked but never deleted."""

from __future__ import annotations

import secrets
from collections.abc import Collection, Sequence
from typing import Any

from sqlalchemy import delete, select
from sqlalchemy.orm import Session
from sqlalchemy.sql import Select

from gear_rattle.service.database.tables import KeyRow, Scope, SessionRow, timestamp
from gear_rattle.service.database.transactions import Transactions
from gear_rattle.service.errors import UnknownKeyError

#: At most this many browsers are signed in with one key; a further browser signs out the oldest.
MOST_SESSIONS = 64
#: Identity of an authorised caller: the id of the key, and the hash of a browser's session token (None for programs).
Identity = tuple[str, str | None]


class AccessKeys(Transactions):
    """The API keys and sessions in a job database. `gear_rattle.service.access` checks the permissions of keys."""

    def add_key(
        self,
        name: str,
        key_hash: str,
        scopes: Collection[Scope],
        max_cells: int | None = None,
        max_running: int | None = None,
    ) -> KeyRow:
        """Add a key.

        Parameters
        ----------
        name : str
            Shown to people; need not be unique.
        key_hash : str
            Hash of the secret, which is not stored.
        scopes : Collection[Scope]
            Permissions of the key.
        max_cells : int | None
            The most cells of all surveys of this key, active and stored; None for no limit.
        max_running : int | None
            The most active surveys of this key; None for the limit of the service.

        Returns
        -------
        KeyRow
            The row, with its new id.
        """
        with self._begin_write_transaction() as (session, _):
            key = KeyRow(
                id=secrets.token_hex(8),
                name=name,
                hash=key_hash,
                scopes=sorted(str(Scope(scope)) for scope in scopes),
                max_cells=max_cells,
                max_running=max_running,
            )
            session.add(key)
        return key

    def keys(self) -> Sequence[KeyRow]:
        """Return every key, oldest first, including revoked ones."""
        with self._begin_read_transaction() as session:
            return session.scalars(select(KeyRow).order_by(KeyRow.created, KeyRow.id)).all()

    def revoke_key(self, key_id: str) -> KeyRow:
        """Revoke a key permanently; its surveys continue. Raises UnknownKeyError if there is no key with this id."""
        with self._begin_write_transaction() as (session, _):
            key = session.get(KeyRow, key_id) if "\0" not in key_id else None
            if key is None:
                raise UnknownKeyError(key_id)
            key.revoked = key.revoked or timestamp()
            session.execute(delete(SessionRow).where(SessionRow.key == key_id))
        return key

    def key_by_hash(self, key_hash: str) -> KeyRow | None:
        """Return the key with this hash; None if there is none, or it was revoked."""
        with self._begin_read_transaction() as session:
            return session.scalars(
                select(KeyRow).where(KeyRow.hash == key_hash, KeyRow.revoked.is_(None))
            ).one_or_none()

    def add_login_session(self, key_id: str, session_hash: str, seconds: float) -> None:
        """Sign a browser in with a key for a number of seconds.

        Delete all expired sessions, and the oldest sessions of the key, so that the key has at most MOST_SESSIONS.
        """
        with self._begin_write_transaction() as (session, _):
            session.execute(delete(SessionRow).where(SessionRow.expires <= timestamp()))
            older = select(SessionRow.hash).where(SessionRow.key == key_id).order_by(SessionRow.created.desc())
            surplus = session.scalars(older.offset(MOST_SESSIONS - 1)).all()
            session.execute(delete(SessionRow).where(SessionRow.hash.in_(surplus)))
            session.add(SessionRow(hash=session_hash, key=key_id, expires=timestamp(seconds)))

    def find_key_of_login_session(self, session_hash: str) -> KeyRow | None:
        """Return the key of a browser's session; None if the session has ended or expired, or the key was revoked."""
        with self._begin_read_transaction() as session:
            return session.scalars(
                _restrict_to_live_logins(select(KeyRow)).where(SessionRow.hash == session_hash)
            ).one_or_none()

    def end_session(self, session_hash: str) -> None:
        """Sign a browser out."""
        with self._begin_write_transaction() as (session, _):
            session.execute(delete(SessionRow).where(SessionRow.hash == session_hash))

    def live_identities(self, identities: Collection[Identity]) -> set[Identity]:
        """Return the identities whose keys are not revoked and whose sessions have neither ended nor expired."""
        keys = {key for key, _ in identities}
        hashes = {session_hash for _, session_hash in identities if session_hash is not None}
        with self._begin_read_transaction() as session:
            live: set[str | None] = set(
                session.scalars(select(KeyRow.id).where(KeyRow.id.in_(keys), KeyRow.revoked.is_(None)))
            )
            on = _live_session_hashes(session, hashes) if hashes else set()
        return {(key, each) for key, each in identities if key in live and (each is None or each in on)}


def _live_session_hashes(session: Session, hashes: set[str]) -> set[str]:
    return set(session.scalars(_restrict_to_live_logins(select(SessionRow.hash)).where(SessionRow.hash.in_(hashes))))


def _restrict_to_live_logins(query: Select[tuple[Any]]) -> Select[tuple[Any]]:
    joined = query.join_from(SessionRow, KeyRow, SessionRow.key == KeyRow.id)
    return joined.where(SessionRow.expires > timestamp(), KeyRow.revoked.is_(None))
