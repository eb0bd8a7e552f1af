"""Comparison maps, in the window of the first map: other variables, other surveys, and differences of surveys."""
