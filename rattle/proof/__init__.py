"""Prove periodic motions as theorems: a finder in ball arithmetic, certificates, and an independent checker."""
