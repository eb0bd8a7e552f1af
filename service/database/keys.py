"""API keys: kept as hashes, revoked but never deleted."""

from __future__ import annotations

import secrets
from collections.abc import Collection, Sequence

from sqlalchemy import select

from service.database.transactions import Transactions
from service.errors import UnknownKeyError
from service.tables import KeyRow, Scope, now


class Keys(Transactions):
    """The keys of a job database. What a key is worth is decided elsewhere."""

    def add_key(
        self,
        name: str,
        key_hash: str,
        scopes: Collection[Scope],
        max_cells: int | None = None,
        max_running: int | None = None,
    ) -> KeyRow:
        """Add a key.

        Args:
            name: for people; need not be unique.
            key_hash: of the secret, which is stored nowhere.
            scopes: what it allows.
            max_cells: cells of all surveys of this key that wait, run or are kept; None for any number.
            max_running: surveys of this key that wait or run, None for the limit of the service.
        """
        with self._write() as (session, _):
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
        """Every key, oldest first, revoked ones too."""
        with self._read() as session:
            return session.scalars(select(KeyRow).order_by(KeyRow.created, KeyRow.id)).all()

    def revoke_key(self, key_id: str) -> KeyRow:
        """Revoke a key for good; its surveys go on. UnknownKeyError if there is none of this id."""
        with self._write() as (session, _):
            key = session.get(KeyRow, key_id) if "\0" not in key_id else None
            if key is None:
                raise UnknownKeyError(key_id)
            key.revoked = key.revoked or now()
        return key

    def key_by_hash(self, key_hash: str) -> KeyRow | None:
        """The key with this hash, unless it was revoked."""
        with self._read() as session:
            return session.scalars(
                select(KeyRow).where(KeyRow.hash == key_hash, KeyRow.revoked.is_(None))
            ).one_or_none()
