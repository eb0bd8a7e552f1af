"""API keys and the owners of surveys; who holds the database, and how many surveys it has."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "keys",
        sa.Column("id", sa.String(), primary_key=True),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("hash", sa.String(), nullable=False),
        sa.Column("scopes", sa.JSON(), nullable=False),
        sa.Column("max_cells", sa.Integer(), nullable=True),
        sa.Column("max_running", sa.Integer(), nullable=True),
        sa.Column("created", sa.String(), nullable=False),
        sa.Column("revoked", sa.String(), nullable=True),
        sa.UniqueConstraint("hash"),
    )
    # Inline, because SQLite adds no constraint to a table that is there, and copying it would delete what refers to it.
    op.add_column("jobs", sa.Column("owner", sa.String(), sa.ForeignKey("keys.id")), inline_references=True)
    op.create_index("ix_jobs_owner", "jobs", ["owner", "number"])
    active = sa.text("state IN ('accepted', 'running')")
    op.create_index("ix_jobs_active", "jobs", ["number"], sqlite_where=active, postgresql_where=active)
    op.create_index(
        "ix_tiles_failed",
        "tiles",
        ["job", "index"],
        sqlite_where=sa.text("failed > 0"),
        postgresql_where=sa.text("failed > 0"),
    )
    op.create_table(
        "service",
        sa.Column("id", sa.Integer(), primary_key=True, autoincrement=False),
        sa.Column("epoch", sa.Integer(), nullable=False),
        sa.Column("surveys", sa.Integer(), nullable=False),
    )
    op.execute("INSERT INTO service (id, epoch, surveys) SELECT 1, 0, count(*) FROM jobs")
