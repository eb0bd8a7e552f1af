"""Figures of the library's results, with matplotlib (the extra `plot`)."""
