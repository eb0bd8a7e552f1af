"""The independent checker of blocks. It imports nothing of this project, and needs only Python and mpmath."""
