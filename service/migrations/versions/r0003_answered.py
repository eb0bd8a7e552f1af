"""Surveys found by what they compute, and the idempotency keys that were answered with one that was there already."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_index("ix_jobs_content", "jobs", ["content_hash", "number"])
    op.create_table(
        "answered",
        sa.Column("idempotency_key", sa.String(), primary_key=True),
        sa.Column("body_hash", sa.String(), nullable=False),
        sa.Column("job", sa.Integer(), sa.ForeignKey("jobs.number", ondelete="CASCADE"), nullable=False),
    )
    op.create_index("ix_answered_job", "answered", ["job"])
