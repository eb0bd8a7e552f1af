"""Theorems about motions: a finder that works in ball arithmetic, certificates, and an independent checker."""
