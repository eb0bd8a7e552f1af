"""Branches, events and cascades of the impacting gear; its bifurcation curves, codimension-two points and diagrams."""
