"""API keys: how a secret is made, written and recognised."""

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

#: Where a browser keeps its session: it cannot send the header Authorization for a page.
COOKIE = "rattle_session"
#: Where older versions kept the key itself: of no use any more, and taken away where one signs in.
OLD_COOKIE = "rattle_key"

#: What a key of this scope may do: who submits may read.
ALLOWS = {Scope.READ: (Scope.READ,), Scope.SUBMIT: (Scope.READ, Scope.SUBMIT)}


@dataclass(frozen=True)
class Caller:
    """Sender of a request: the owner of a key, or anybody where no key is needed."""

    key: KeyRow | None = None
    session: str | None = None  # the hash of a browser's, if it was that which was shown

    @property
    def identity(self) -> Identity | None:
        """Identity that decides whether this caller may stay; None where no key is needed."""
        return (self.key.id, self.session) if self.key else None

    @property
    def owner(self) -> str | None:
        """The id that the surveys of this caller carry."""
        return self.key.id if self.key else None

    def may(self, scope: Scope) -> bool:
        """Return whether the caller has a scope."""
        return self.key is None or scope in self.key.scopes

    def owns(self, job: JobRow) -> bool:
        """Return whether the caller owns a job."""
        return self.key is None or job.owner == self.key.id


def add_key(
    database: Database, name: str, scope: Scope, max_cells: int | None = None, max_running: int | None = None
) -> tuple[KeyRow, str]:
    """Add a key. The token in the result is what its owner sends; it is shown here and never again."""
    secret = secrets.token_urlsafe(SECRET_BYTES)
    key = database.add_key(name, hash_of(secret), ALLOWS[scope], max_cells, max_running)
    return key, f"rattle_{key.id}_{secret}"


def find_key(database: Database, token: str) -> KeyRow | None:
    """Return the live key that this token belongs to. Asks the database each time: a revoked key is refused at once."""
    parts = TOKEN.fullmatch(token)
    if parts is None:
        return None
    secret_hash = hash_of(parts[2])
    key = database.key_by_hash(secret_hash)
    if key is None:
        return None
    same = hmac.compare_digest(key.hash, secret_hash) and hmac.compare_digest(key.id, parts[1])
    return key if same else None


def begin_session(database: Database, key: KeyRow, seconds: float) -> str:
    """Sign a browser in with a key. What is returned is what its cookie holds, and nothing else."""
    token = secrets.token_urlsafe(SECRET_BYTES)
    database.add_session(key.id, hash_of(token), seconds)
    return token


def find_session(database: Database, token: str) -> Caller | None:
    """Return the caller whose browser holds this token.

    None once it has signed out, or its time is over, or its key revoked.

    Returns
    -------
    Caller | None
        The caller, or None.
    """
    session = hash_of(token)
    key = database.key_by_session(session)
    return Caller(key, session) if key is not None else None


def has_live_key(database: Database) -> bool:
    """Return whether anybody could be let in."""
    return any(key.revoked is None for key in database.keys())  # noqa: SIM118 - no dict


def hash_of(secret: str) -> str:
    """Return the stored hash of a secret.

    One SHA-256 is enough: 256 random bits cannot be guessed however fast a guess is, which is all that the slow hashes
    for passwords prevent, and each request pays for it.

    Returns
    -------
    str
        The digest.
    """
    return hashlib.sha256(secret.encode()).hexdigest()
