"""Levels: a survey at lower and lower resolution, where each cell of a level summarizes several cells of the survey."""
