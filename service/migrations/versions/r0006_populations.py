"""Populations beside surveys: which a job is, and how many of either there are."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("jobs", sa.Column("kind", sa.String(), nullable=False, server_default="survey"))
    op.create_index("ix_jobs_kind", "jobs", ["kind", "number"])
    op.add_column("service", sa.Column("populations", sa.Integer(), nullable=False, server_default="0"))
