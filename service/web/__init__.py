"""The processing that all HTTP requests and answers pass through."""
