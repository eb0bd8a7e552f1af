"""Branches, events and cascades of the impacting gear; its curves and points of codimension two; its diagram."""
