"""The settings and limits of the service, read from environment variables ``RATTLE_…``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

#: Pattern of `root_path`: a path of plain segments. "//HOST" does not match, because a browser would take it for
#: another site.
ROOT_PATH = re.compile(r"(/[A-Za-z0-9_~-][A-Za-z0-9._~-]*)*")


class Settings(BaseSettings):
    """The settings of one service process. Arguments take precedence over environment variables."""

    model_config = SettingsConfigDict(env_prefix="RATTLE_", frozen=True)

    data: Annotated[Path, AfterValidator(Path.expanduser)] = Field(
        default=Path("data"), description="directory of the job database and the stores"
    )
    database_url: str | None = Field(default=None, description="SQLAlchemy URL; SQLite in the data directory if absent")
    store: str | None = Field(
        default=None, description="s3://BUCKET/PREFIX of the stores; the data directory if absent"
    )
    host: str = Field(default="127.0.0.1", min_length=1)
    port: int = Field(default=8000, ge=0, le=65535)
    insecure: bool = Field(default=False, description="require no API keys, whatever the address")
    require_keys: bool = Field(
        default=False, description="require API keys on loopback too, for example behind a proxy"
    )
    behind_proxy: bool = Field(
        default=False,
        description="a proxy in front provides TLS, cuts off slow clients, and sends scheme and path in "
        "X-Forwarded-Proto and X-Forwarded-Prefix",
    )
    root_path: str = Field(default="", description="path at which a proxy publishes this service, such as /rattle")
    allowed_hosts: Annotated[tuple[str, ...], NoDecode] = Field(
        default=(), description="further names of this service, separated by commas; for requests without a key"
    )
    cors_origins: Annotated[tuple[str, ...], NoDecode] = Field(
        default=(), description="origins whose pages may read, separated by commas, such as https://maps.example"
    )
    session_seconds: float = Field(
        default=7 * 86_400, gt=0, le=10 * 365 * 86_400, description="longest time for which a browser stays signed in"
    )
    log_format: Literal["text", "json"] = Field(default="text", description="format of log records: text or JSON lines")
    scheduler: str | None = Field(default=None, description="dask scheduler; an embedded cluster if absent")
    workers: int = Field(default=2, ge=1, le=256, description="processes of the embedded cluster")

    max_body_bytes: int = Field(default=64 * 1024, ge=1)
    max_header_bytes: int = Field(default=16 * 1024, ge=1024, description="request line and headers of one request")
    max_headers: int = Field(default=100, ge=16, description="header lines of one request")
    max_connections: int = Field(default=512, ge=1, description="open connections; further ones are answered with 503")
    idle_seconds: int = Field(default=20, ge=1, description="an idle connection is kept open for this long")
    max_cells: int = Field(default=1_000_000, ge=1, description="cells of one survey")
    max_tiles: int = Field(default=20_000, ge=1, description="tiles of one survey; each is a file per variable")
    max_count: int = Field(default=4096, ge=1, description="initial conditions of one cell")
    max_samples: int = Field(
        default=256_000_000, ge=1, description="cells times initial conditions of one survey; basins count as 4096"
    )
    # A dismissed survey's running task is ended by killing its worker, but only if the worker has a nanny and runs no
    # other task. `max_tile_samples` bounds the time for which other tasks may still run after the dismissal.
    max_tile_samples: int = Field(default=1_048_576, ge=1, description="cells times initial conditions of one tile")
    max_jobs: int = Field(default=32, ge=1, description="surveys waiting or running")

    max_point_count: int = Field(default=1024, ge=1, description="initial conditions of GET /v1/attractors")
    max_basin_resolution: int = Field(default=1000, ge=1, description="cells a side of GET /v1/basins.png")
    max_points: int = Field(default=2, ge=1, description="parameter points computed at once, each in a process")
    max_point_seconds: float = Field(default=60.0, gt=0, description="longest wait for a point or for curves")
    max_points_waiting: int = Field(default=16, ge=0, description="parameter points waiting for their turn")
    explorer: bool = Field(default=True, description="the page at /, which takes 2 s of a core after the start")
    preload: bool = Field(
        default=True,
        description="prepare kernels and the first map at the start, which takes 5 s of a core; else on first use",
    )
    max_windows: int = Field(default=2, ge=1, description="windows of the explorer refined at once; others wait")
    max_pages: int = Field(default=100, ge=1, description="open pages of the explorer")
    heartbeat_seconds: float = Field(default=15.0, gt=0, description="seconds between heartbeats of event streams")
    shutdown_seconds: int = Field(default=2, ge=1, le=3, description="open requests may take this long at shutdown")

    @field_validator("allowed_hosts", "cors_origins", mode="before")
    @classmethod
    def _split_commas(cls, given: object) -> object:
        return [name.strip() for name in given.split(",") if name.strip()] if isinstance(given, str) else given

    @field_validator("root_path")
    @classmethod
    def _check_root_path(cls, given: str) -> str:
        path = given.rstrip("/")
        if not ROOT_PATH.fullmatch(path):
            raise ValueError(f"{given!r} is not a path of plain segments: write the path like /rattle or /apps/rattle")
        return path

    @field_validator("cors_origins")
    @classmethod
    def _check_origins(cls, given: tuple[str, ...]) -> tuple[str, ...]:
        for origin in given:
            if not re.fullmatch(r"https?://[^/*\s]+", origin):
                raise ValueError(f"{origin!r} is not an origin: write each as https://HOST or http://HOST:PORT")
        return given

    @model_validator(mode="after")
    def _forbid_insecure_with_keys(self) -> Self:
        if self.insecure and self.require_keys:
            raise ValueError("insecure and require_keys contradict each other: leave one of them out")
        return self
