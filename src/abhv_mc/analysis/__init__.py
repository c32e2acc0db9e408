"""Analyses of a simulated campaign: replay, explanation of failures, other distributions."""
