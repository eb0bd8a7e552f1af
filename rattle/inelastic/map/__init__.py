"""Forcing of several harmonics, flights, impacts with restitution, contact phases, trajectories."""
