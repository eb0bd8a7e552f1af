"""The schema of the job database, as alembic revisions.

A new revision is one file in ``versions``: copy the last revision, give it the next number, and change
service/database/tables.py in the same way; a test compares both. There are upgrades only, no downgrades. A revision
runs in one transaction, also on SQLite.
"""
