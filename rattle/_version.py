"""The version of the project, which is stated only here."""

__version__ = "1.0.0rc1"
