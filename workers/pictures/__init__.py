"""Draw maps with matplotlib."""
