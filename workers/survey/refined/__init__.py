"""Tiles of a refined survey: compute a coarse grid of cells, add cells where motions differ, and fill the others."""
