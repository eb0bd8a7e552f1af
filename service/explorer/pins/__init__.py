"""Points that are kept side by side, to be compared."""
