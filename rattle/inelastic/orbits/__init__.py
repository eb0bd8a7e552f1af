"""Periodic motions of the inelastic gear: A and C in closed form, any other from its return map."""
