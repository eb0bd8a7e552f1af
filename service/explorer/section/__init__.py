"""Draw the profile of a survey along the line of a diagram, below the diagram."""
