"""Kernels for stability margins: plant and laws at points, loop gains, singular values."""
