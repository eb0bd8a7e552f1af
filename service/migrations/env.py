"""Run by alembic, on the connection that :mod:`service.database.schema` hands over, inside its transaction."""

from alembic import context

from service.database.tables import Table

context.configure(connection=context.config.attributes["connection"], target_metadata=Table.metadata)
context.run_migrations()
