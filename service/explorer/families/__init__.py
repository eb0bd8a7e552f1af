"""One family of a survey's attractors: what is known of it, and where it is on the map."""
