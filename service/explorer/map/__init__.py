"""The map, and what lies over it."""
