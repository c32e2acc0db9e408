"""Earth, atmosphere and wind."""
