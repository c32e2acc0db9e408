"""Flights of the built-in simulator: signals, outcomes, metrics, plans and simulation."""
