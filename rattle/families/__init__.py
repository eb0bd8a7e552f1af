"""One motion, one number over the plane: the attractors of a grid of cells, joined between neighbours."""
