"""Flights of the built-in simulator: channels, outcomes, metrics, plans and simulation."""
