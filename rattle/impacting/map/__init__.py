"""The impact map Π, capture by quiet motion, trajectories, and the grazing curve Γ."""
