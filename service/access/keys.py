"""API keys: make a secret, store its hash, and recognise it."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gear_rattle.service.database.tables import JobRow, KeyRow, Scope

if TYPE_CHECKING:
    from gear_rattle.service.database import Database
    from gear_rattle.service.database.keys import Identity

SECRET_BYTES = 32
TOKEN = re.compile(r"rattle_([0-9a-f]{16})_([A-Za-z0-9_-]{43})", re.ASCII)

#: Cookie with a browser's session, because a browser cannot send the header Authorization for a page.
COOKIE = "rattle_session"
#: Cookie in which older versions kept the key itself; signing in removes it.
OLD_COOKIE = "rattle_key"

#: {scope that is requested for a new key: scopes that the key gets}. A key that may submit may also read.
GRANTED_SCOPES = {Scope.READ: (Scope.READ,), Scope.SUBMIT: (Scope.READ, Scope.SUBMIT)}


@dataclass(frozen=True)
class Caller:
    """The sender of a request: the owner of a key, or anybody if the request needs no key."""

    key: KeyRow | None = None
    session: str | None = None  # hash of the browser's session, if the request has one

    @property
    def identity(self) -> Identity | None:
        """The caller's identity (id of the key, hash of the browser's session); None for a caller without a key.

        The hash is None if the request has the key itself instead of a session's cookie.
        """
        return (self.key.id, self.session) if self.key else None

    @property
    def owner(self) -> str | None:
        """Id of the key that owns this caller's surveys; None without a key."""
        return self.key.id if self.key else None

    def has_scope(self, scope: Scope) -> bool:
        """Return whether the caller has this scope. A caller without a key has all scopes."""
        return self.key is None or scope in self.key.scopes

    def is_owner_of(self, job: JobRow) -> bool:
        """Return whether the caller owns a job. A caller without a key owns all jobs."""
        return self.key is None or job.owner == self.key.id


def add_key(
    database: Database, name: str, scope: Scope, max_cells: int | None = None, max_running: int | None = None
) -> tuple[KeyRow, str]:
    """Add a key. Return its row and the token that its owner sends; the token is not stored, so show it now."""
    secret = secrets.token_urlsafe(SECRET_BYTES)
    key = database.add_key(name, hash_secret(secret), GRANTED_SCOPES[scope], max_cells, max_running)
    return key, f"rattle_{key.id}_{secret}"


def find_key_of_token(database: Database, token: str) -> KeyRow | None:
    """Return the valid key with this token, or None. The database is read each time, so a revoked key fails at once."""
    parts = TOKEN.fullmatch(token)
    if parts is None:
        return None
    secret_hash = hash_secret(parts[2])
    key = database.key_by_hash(secret_hash)
    if key is None:
        return None
    same = hmac.compare_digest(key.hash, secret_hash) and hmac.compare_digest(key.id, parts[1])
    return key if same else None


def begin_session(database: Database, key: KeyRow, seconds: float) -> str:
    """Sign a browser in with a key, and return the token for its cookie."""
    token = secrets.token_urlsafe(SECRET_BYTES)
    database.add_login_session(key.id, hash_secret(token), seconds)
    return token


def find_caller_of_session(database: Database, token: str) -> Caller | None:
    """Return the caller whose browser has this session token; None if the session has ended or the key was revoked."""
    session = hash_secret(token)
    key = database.find_key_of_login_session(session)
    return Caller(key, session) if key is not None else None


def has_live_key(database: Database) -> bool:
    """Return whether the database has a key that was not revoked."""
    return any(key.revoked is None for key in database.keys())  # noqa: SIM118 - no dict


def hash_secret(secret: str) -> str:
    """Return the hash of a secret, which the database stores in place of the secret.

    One SHA-256 suffices, because nobody can guess 256 random bits. The slow hashes for passwords, which make guessing
    expensive, would only cost time at each request.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    return hashlib.sha256(secret.encode()).hexdigest()
