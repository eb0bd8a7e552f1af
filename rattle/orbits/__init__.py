"""What any return map has: iterates and tangents, periodic orbits, saddles, manifolds."""
