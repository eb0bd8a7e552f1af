"""One clicked point."""
