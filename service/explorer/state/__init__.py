"""State of a page: its view, the events that change it, and the store that tells panels of changes."""
