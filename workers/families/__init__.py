"""Join the attractors of a survey to families, block by block, after all tiles; and open one family as a map."""
