"""Modules that all parts of the explorer share: address, texts, figures, glyphs, job status, page session."""
