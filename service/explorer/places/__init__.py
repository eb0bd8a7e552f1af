"""Maps that need no computed survey: the example, and closed forms."""
