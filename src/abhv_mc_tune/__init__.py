"""Tuning of a controller's numbers, validated against the initial ones on fresh flights."""
