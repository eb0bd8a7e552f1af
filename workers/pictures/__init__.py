"""Maps, with matplotlib."""
