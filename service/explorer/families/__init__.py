"""A chosen family of a survey's attractors: its description, and its cells on the map."""
