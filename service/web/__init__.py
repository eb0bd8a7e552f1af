"""Common processing of all HTTP answers."""
