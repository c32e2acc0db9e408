"""Kernels for stability margins: plant and laws at single points, loop gains, mu."""
