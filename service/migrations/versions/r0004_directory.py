"""The data directory where the stores are, by its identity."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("service", sa.Column("directory", sa.String(), nullable=True))
