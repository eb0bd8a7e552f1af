"""The boundary crisis of the chaotic attractor."""
