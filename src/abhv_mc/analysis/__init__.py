"""Analyses of a simulated campaign: replay, explanation and other distributions."""
