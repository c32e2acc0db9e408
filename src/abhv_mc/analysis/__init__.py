"""Analyses of a simulated campaign: replay, explanation of failures, re-weighting."""
