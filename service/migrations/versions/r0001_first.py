"""The schema of the first release."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

ACTIVE, FAILED = sa.text("state IN ('accepted', 'running')"), sa.text("failed > 0")


def upgrade() -> None:
    """Create the tables."""
    op.create_table(
        "keys",
        sa.Column("id", sa.String(), primary_key=True),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("hash", sa.String(), nullable=False, unique=True),
        sa.Column("scopes", sa.JSON(), nullable=False),
        sa.Column("max_cells", sa.Integer()),
        sa.Column("max_running", sa.Integer()),
        sa.Column("created", sa.String(), nullable=False),
        sa.Column("revoked", sa.String()),
    )
    op.create_table(
        "sessions",
        sa.Column("hash", sa.String(), primary_key=True),
        sa.Column("key", sa.String(), sa.ForeignKey("keys.id", ondelete="CASCADE"), nullable=False, index=True),
        sa.Column("created", sa.String(), nullable=False),
        sa.Column("expires", sa.String(), nullable=False),
    )
    op.create_table(
        "jobs",
        sa.Column("number", sa.Integer(), primary_key=True, autoincrement=True),
        sa.Column("id", sa.String(), nullable=False, unique=True),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("notes", sa.String(), nullable=False),
        sa.Column("state", sa.String(), nullable=False, index=True),
        sa.Column("message", sa.String(), nullable=False),
        sa.Column("request", sa.JSON(), nullable=False),
        sa.Column("content_hash", sa.String(), nullable=False),
        sa.Column("idempotency_key", sa.String(), unique=True),
        sa.Column("body_hash", sa.String(), nullable=False),
        sa.Column("n_cells", sa.Integer(), nullable=False),
        sa.Column("n_tiles", sa.Integer(), nullable=False),
        sa.Column("cells_done", sa.Integer(), nullable=False),
        sa.Column("tiles_done", sa.Integer(), nullable=False),
        sa.Column("cells_failed", sa.Integer(), nullable=False),
        sa.Column("last_event", sa.Integer(), nullable=False),
        sa.Column("created", sa.String(), nullable=False),
        sa.Column("started", sa.String()),
        sa.Column("finished", sa.String()),
        sa.Column("owner", sa.String(), sa.ForeignKey("keys.id")),
        sa.Column("kind", sa.String(), nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_jobs_owner", "jobs", ["owner", "number"])
    op.create_index("ix_jobs_kind", "jobs", ["kind", "number"])
    op.create_index("ix_jobs_content", "jobs", ["content_hash", "number"])
    op.create_index("ix_jobs_active", "jobs", ["number"], sqlite_where=ACTIVE, postgresql_where=ACTIVE)
    op.create_table(
        "events",
        sa.Column("job", sa.Integer(), sa.ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True),
        sa.Column("id", sa.Integer(), primary_key=True),
        sa.Column("kind", sa.String(), nullable=False),
        sa.Column("data", sa.JSON(), nullable=False),
        sa.Column("at", sa.String(), nullable=False),
    )
    op.create_table(
        "tiles",
        sa.Column("job", sa.Integer(), sa.ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True),
        sa.Column("index", sa.Integer(), primary_key=True),
        sa.Column("cells", sa.Integer(), nullable=False),
        sa.Column("seconds", sa.Double(), nullable=False),
        sa.Column("failed", sa.Integer(), nullable=False),
        sa.Column("failures", sa.JSON(), nullable=False),
    )
    op.create_index("ix_tiles_failed", "tiles", ["job", "index"], sqlite_where=FAILED, postgresql_where=FAILED)
    op.create_table(
        "answered",
        sa.Column("idempotency_key", sa.String(), primary_key=True),
        sa.Column("body_hash", sa.String(), nullable=False),
        sa.Column("job", sa.Integer(), sa.ForeignKey("jobs.number", ondelete="CASCADE"), nullable=False, index=True),
        sa.Column("at", sa.String(), nullable=False),
    )
    op.create_table(
        "service",
        sa.Column("id", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("epoch", sa.Integer(), nullable=False),
        sa.Column("surveys", sa.Integer(), nullable=False),
        sa.Column("populations", sa.Integer(), nullable=False),
        sa.Column("directory", sa.String()),
    )
    op.execute("INSERT INTO service (id, epoch, surveys, populations) VALUES (1, 0, 0, 0)")
