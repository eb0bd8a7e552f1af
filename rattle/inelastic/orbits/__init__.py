"""Periodic motions of the inelastic gear: A and C in closed form, others from the return map."""
