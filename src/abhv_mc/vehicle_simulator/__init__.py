"""Simulators: the built-in vehicle simulation with its plans, and user simulators."""
