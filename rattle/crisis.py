"""The boundary crisis of the chaotic attractor: the ε at which the unstable and the stable manifold of A first meet.

Only the branch of the unstable manifold on the side of the attractor counts. `boundary_crisis` finds this ε at one
damping, and `crisis_curve` follows it over a range of dampings. See docs/crisis.md.
"""

from rattle.impacting.crisis.contact import Crisis
from rattle.impacting.crisis.curve import CrisisCurve, crisis_curve
from rattle.impacting.crisis.search import boundary_crisis

__all__ = ["Crisis", "CrisisCurve", "boundary_crisis", "crisis_curve"]
