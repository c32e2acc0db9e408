"""Kernels of stability margins: plant and laws at points, loop gains, mu."""
