"""Explain differences between two cells by the curve that passes between them."""
