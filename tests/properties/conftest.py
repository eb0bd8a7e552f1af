"""No example is too slow: how long one takes says nothing of what it tests. By default there are half as many."""

from depth import either
from hypothesis import HealthCheck, settings

settings.register_profile(
    "any speed", deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=either(50, 100)
)
settings.load_profile("any speed")
