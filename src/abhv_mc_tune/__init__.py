"""Tuning of controller parameters, validated against the initial values on new flights."""
