"""Analyses of a simulated campaign: replay, explanation, other distributions."""
