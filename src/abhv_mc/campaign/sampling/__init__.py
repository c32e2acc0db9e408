"""Sampling: designs, marginal distributions and correlation."""
