"""Run by alembic, on the connection that service/database/schema.py hands over, inside its transaction."""

from alembic import context

from gear_rattle.service.database.tables import Table

context.configure(connection=context.config.attributes["connection"], target_metadata=Table.metadata)
context.run_migrations()
