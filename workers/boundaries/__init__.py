"""Explain why neighbouring cells of a survey differ, by the bifurcation curve that passes between them."""
