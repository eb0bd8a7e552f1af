"""Draw a survey along the line of a diagram, above the diagram."""
