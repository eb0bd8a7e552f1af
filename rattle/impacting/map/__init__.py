"""The impact map Π, its capture by quiet motion, trajectories, and Γ."""
