"""Settings of all tests: generated examples are the same on every run, and take the time they take."""

from hypothesis import HealthCheck, settings

settings.register_profile("stimlib", derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
settings.load_profile("stimlib")
