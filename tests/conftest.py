"""Settings of every test."""

from hypothesis import settings

# The first call of a compiled function compiles it: no deadlines.
settings.register_profile("compiled", deadline=None)
settings.load_profile("compiled")
