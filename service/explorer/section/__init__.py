"""What a survey has along the line of a diagram, above the diagram."""
