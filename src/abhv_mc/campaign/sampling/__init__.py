"""Sampling designs, marginal distributions and correlations."""
