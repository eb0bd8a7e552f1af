"""Periodic motions of the inelastic gear: P(1,1,0) in closed form, P(1,1,1) as an explicit family, others by Newton."""
