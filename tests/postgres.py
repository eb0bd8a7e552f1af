"""A private PostgreSQL server for tests: in a directory of its own, on a Unix socket only, gone with the tests."""

import os
import pwd
import secrets
import shutil
import signal
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path

import psycopg
from waiting import HANG, wait_until


def missing() -> str:
    """Why no server can be started here; empty if one can."""
    if _programs() is None:
        return (
            "PostgreSQL is not installed (apt-get install postgresql): no initdb in /usr/lib/postgresql/*/bin or PATH"
        )
    if os.geteuid() == 0 and (_user() is None or shutil.which("setpriv") is None):
        return "PostgreSQL does not run as root, and there is no user postgres or nobody, or no setpriv, to run it with"
    return ""


def _programs() -> Path | None:
    installed = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: float(path.parts[-3]))
    found = str(installed[-1]) if installed else shutil.which("initdb")
    return Path(found).resolve().parent if found else None


def _user() -> str | None:
    for name in ("postgres", "nobody"):
        with suppress(KeyError):
            return pwd.getpwnam(name).pw_name
    return None


class Postgres:
    """A running server; :meth:`close` stops it and removes everything.

    Args:
        primary: whose standby this is, if any: every commit is in both before anybody is told of it.
    """

    def __init__(self, primary: "Postgres | None" = None) -> None:
        programs = _programs()
        assert programs is not None
        self._programs = programs
        # Not under pytest's directories: those are closed to the user that PostgreSQL runs as, and long for a socket.
        self._directory = Path(tempfile.mkdtemp(prefix="rattle-pg-"))
        self._process: subprocess.Popen[bytes] | None = None
        self._as_user: list[str] = []
        if os.geteuid() == 0:
            user = pwd.getpwnam(str(_user()))
            os.chown(self._directory, user.pw_uid, user.pw_gid)
            self._as_user = [f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups"]
        try:
            data = str(self._directory / "data")
            if primary is None:
                made = ["initdb", "-U", "rattle", "-A", "trust", "-E", "UTF8", "--locale=C"]
            else:
                made = ["pg_basebackup", "-h", str(primary._directory), "-U", "rattle", "-R", "--checkpoint=fast"]
            self._run(*made, "-D", data, "--no-sync").wait()
            self.start()
            if primary is not None:
                primary.execute("ALTER SYSTEM SET synchronous_standby_names = '*'")
                primary.execute("SELECT pg_reload_conf()")
        except BaseException:
            self.close()
            raise

    def start(self) -> None:
        """Start the server and wait until it answers."""
        settings = {"listen_addresses": "", "unix_socket_directories": self._directory, "fsync": "off"}
        options = [part for name, value in settings.items() for part in ("-c", f"{name}={value}")]
        self._process = self._run("postgres", "-D", str(self._directory / "data"), *options)
        wait_until(self._answers)

    def _answers(self) -> bool:
        assert self._process is not None
        try:
            self.execute("SELECT 1")
        except psycopg.OperationalError:
            assert self._process.poll() is None, self.log
            return False
        return True

    def stop(self, how: signal.Signals = signal.SIGINT) -> None:
        """Stop the server: SIGINT is a fast shutdown, SIGQUIT an immediate one, as if it had crashed."""
        if self._process is not None:
            self._process.send_signal(how)
            self._process.wait(timeout=HANG)
            self._process = None

    def close(self) -> None:
        self.stop(signal.SIGQUIT)
        shutil.rmtree(self._directory, ignore_errors=True)

    def create(self, encoding: str = "UTF8") -> str:
        """Create an empty database; its URL."""
        name = f"test_{secrets.token_hex(6)}"
        self.execute(f"CREATE DATABASE {name} TEMPLATE template0 ENCODING '{encoding}'")
        return f"postgresql://rattle@/{name}?host={self._directory}"

    def or_else(self, url: str, other: "Postgres") -> str:
        """URL of the same database on whichever of two servers takes writes."""
        return f"{url}&host={other._directory}&target_session_attrs=read-write"

    def drop(self, url: str) -> None:
        """Drop a database that :meth:`create` made, whoever is connected to it."""
        self.execute(f"DROP DATABASE {url.partition('@/')[2].partition('?')[0]} WITH (FORCE)")

    def execute(self, statement: str) -> None:
        """Execute a statement in the database that every server has."""
        with psycopg.connect(f"host={self._directory} user=rattle dbname=postgres", autocommit=True) as connection:
            connection.execute(statement)

    @property
    def log(self) -> str:
        return (self._directory / "log").read_text()

    def _run(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        # A server whose tests were killed stops, too.
        wrapper = ["setpriv", "--pdeathsig", "QUIT", *self._as_user] if shutil.which("setpriv") else []
        with (self._directory / "log").open("ab") as log:
            return subprocess.Popen(
                [*wrapper, str(self._programs / program), *arguments],
                cwd="/",
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
