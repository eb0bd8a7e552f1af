"""Run the migrations. alembic executes this file, with the connection and transaction of service/database/schema.py."""

from alembic import context

from gear_rattle.service.database.tables import TableBase

context.configure(connection=context.config.attributes["connection"], target_metadata=TableBase.metadata)
context.run_migrations()
