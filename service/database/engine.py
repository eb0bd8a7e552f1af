"""Open SQLite or PostgreSQL so that transactions work alike in both, and commits survive a power failure."""

from __future__ import annotations

import json
import os
from typing import Any

from sqlalchemy import URL, Connection, Engine, NullPool, create_engine, event, make_url
from sqlalchemy.exc import InvalidatePoolError

from gear_rattle.service.errors import DataDirectoryError

BUSY_SECONDS = 10  # longest wait for another writer, or for a connection
POOL = {"pool_size": 10, "max_overflow": 30, "pool_timeout": BUSY_SECONDS, "pool_pre_ping": True}
FILE = "file"  # key in a connection's `info`; its value is the identity of the opened SQLite file
FILE_REPLACED = "Another file has replaced the SQLite file since this connection was opened. The file is opened again."
UNPOOLED = {"poolclass": NullPool}


def open_engine(url: str | URL, pool: dict[str, Any] = POOL) -> Engine:
    """Return the SQLAlchemy engine of a job database. No connection is opened yet.

    Parameters
    ----------
    url : str | URL
        SQLAlchemy URL of the database.
    pool : dict[str, Any]
        Options of the connection pool. With :data:`UNPOOLED` each connection is closed after its use.

    Returns
    -------
    Engine
        The engine for SQLite or PostgreSQL, with pragmas and limits set.

    Raises
    ------
    DataDirectoryError
        The URL is neither a SQLite file nor PostgreSQL.
    """
    parsed = make_url(url)
    kind = parsed.get_backend_name()
    if kind == "postgresql":
        return _open_postgresql(parsed, pool)
    if kind == "sqlite" and ":memory:" not in (parsed.database or ":memory:") and "mode" not in parsed.query:
        return _open_sqlite(parsed, pool)
    raise DataDirectoryError(
        f"The job database {url_without_password(parsed)} is neither a SQLite file nor a PostgreSQL database: use "
        "sqlite:///FILE or postgresql://USER@HOST/DATABASE."
    )


def url_without_password(url: URL) -> str:
    """Return the URL without its password, for messages and logs."""
    return url.render_as_string(hide_password=True)


def _decode_json(text: Any) -> Any:
    """Decode a JSON value, or return None if it is damaged, so that one row does not prevent reading the others."""
    try:
        return json.loads(text)
    except (ValueError, TypeError, RecursionError):
        return None


def _decode_text(stored: bytes) -> str:
    return stored.decode("utf-8", "replace")  # one damaged row must not prevent reading the others


def _open_sqlite(url: URL, pool: dict[str, Any]) -> Engine:
    engine = create_engine(url, json_deserializer=_decode_json, **pool)

    @event.listens_for(engine, "connect")
    def set_pragmas(connection: Any, record: Any) -> None:
        record.info[FILE] = _file_identity(url)
        connection.text_factory = _decode_text
        connection.isolation_level = None  # SQLAlchemy starts transactions, not sqlite3
        # synchronous=FULL: with NORMAL, SQLite in WAL mode may lose, in a power failure, commits that clients know of.
        for pragma in ("synchronous=FULL", "foreign_keys=ON", f"busy_timeout={BUSY_SECONDS}000"):
            connection.execute(f"PRAGMA {pragma}")

    @event.listens_for(engine, "checkout")
    def require_same_file(connection: Any, record: Any, proxy: object) -> None:  # noqa: ARG001 - SQLAlchemy's signature
        # A disk that was missing may return as another device, and open connections would still write to the old one.
        if (found := _file_identity(url)) is not None and found != record.info[FILE]:
            raise InvalidatePoolError(FILE_REPLACED)

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:
        # A transaction that will write after it has read must hold the write lock from its start, because SQLite
        # refuses the write if another writer has written in between.
        writes = connection.get_execution_options().get("writes", False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine


def _file_identity(url: URL) -> tuple[int, int] | None:
    """Return the device and inode numbers of the file at a SQLite database's path, or None if there is no file."""
    try:
        found = os.stat(str(url.database))
    except OSError:
        return None
    return found.st_dev, found.st_ino


def _open_postgresql(url: URL, pool: dict[str, Any]) -> Engine:
    if url.drivername == "postgresql":
        url = url.set(drivername="postgresql+psycopg")
    # With these limits, a stuck writer or a vanished host blocks other writers for seconds, not indefinitely.
    limits = {"lock_timeout": f"{BUSY_SECONDS}s", "idle_in_transaction_session_timeout": "60s"}
    alive = {"tcp_keepalives_idle": 10, "tcp_keepalives_interval": 5, "tcp_keepalives_count": 3}
    given = url.query.get("options", "")
    options = [given if isinstance(given, str) else " ".join(given)]
    options += [f"-c {name}={value}" for name, value in (limits | alive).items()]
    client: dict[str, int | str] = {
        "connect_timeout": 5,
        "keepalives_idle": 10,
        "keepalives_interval": 5,
        "keepalives_count": 3,
        "client_encoding": "UTF8",  # otherwise SQLAlchemy cannot read the version of a SQL_ASCII database
    }
    arguments = {name: value for name, value in client.items() if name not in url.query}
    return create_engine(
        url,
        connect_args=arguments | {"options": " ".join(options).strip()},
        isolation_level="READ COMMITTED",  # a writer sees the commits of the writer before it
        **pool,
    )
