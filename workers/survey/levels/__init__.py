"""Levels: a survey in less and less resolution, each cell of a level what several cells of the survey have."""
