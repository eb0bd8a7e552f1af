"""Sessions of browsers, and when an idempotency key was answered, so that the oldest can be forgotten."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "sessions",
        sa.Column("hash", sa.String(), primary_key=True),
        sa.Column("key", sa.String(), sa.ForeignKey("keys.id", ondelete="CASCADE"), nullable=False),
        sa.Column("created", sa.String(), nullable=False),
        sa.Column("expires", sa.String(), nullable=False),
    )
    op.create_index("ix_sessions_key", "sessions", ["key"])
    op.add_column("answered", sa.Column("at", sa.String(), nullable=False, server_default=""))
