"""The attractors of a survey joined to families after its tiles, block by block, and one family as a map."""
