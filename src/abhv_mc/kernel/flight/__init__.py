"""Simulation of a flight from start to end: measurement, control law, plant, metrics."""
