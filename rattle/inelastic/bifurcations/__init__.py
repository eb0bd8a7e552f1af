"""Bifurcation curves of the period-one motions of the inelastic gear, and the points where they meet."""
