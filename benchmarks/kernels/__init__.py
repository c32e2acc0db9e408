"""Single kernels as ratios of times."""
