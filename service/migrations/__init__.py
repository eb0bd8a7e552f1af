"""The schema of the job database, as alembic revisions.

A new revision is one file in ``versions``: copy the last one, number it on, and change service/database/tables.py
likewise; a test compares the two. Upgrades only: a service never goes back. A revision runs in one transaction, on
SQLite too.
"""
