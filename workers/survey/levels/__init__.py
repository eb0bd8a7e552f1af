"""Pyramid levels: a survey at lower and lower resolution. A cell of a level summarizes several cells of the survey."""
