"""Which curve passes between two cells."""
