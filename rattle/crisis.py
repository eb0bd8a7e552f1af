"""The boundary crisis of the chaotic attractor: the ε at which W^u(A), on the side of the attractor, meets W^s(A).

`boundary_crisis` finds it at one damping, `crisis_curve` follows it over a range. docs/crisis.md.
"""

from rattle.impacting.crisis.contact import Crisis
from rattle.impacting.crisis.curve import CrisisCurve, crisis_curve
from rattle.impacting.crisis.search import boundary_crisis

__all__ = ["Crisis", "CrisisCurve", "boundary_crisis", "crisis_curve"]
