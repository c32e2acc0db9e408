"""Tuning of controller parameters, with validation against the initial values."""
