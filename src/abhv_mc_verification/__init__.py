"""Verification of the plant against check-cases, reference flights and publications."""
