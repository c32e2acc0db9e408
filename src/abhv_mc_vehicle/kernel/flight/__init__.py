"""Compiled simulation of a flight: measurement, control law, plant and metrics."""
