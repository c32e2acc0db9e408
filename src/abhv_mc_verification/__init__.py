"""Verification of the simulation against check-cases, recorded flights and publications."""
