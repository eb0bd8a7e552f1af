"""Join the attractors of a survey to families after its tiles, block by block; one family as a map."""
