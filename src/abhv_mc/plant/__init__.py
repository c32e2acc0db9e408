"""Dispersed parameters, control effectiveness and trim of the plant."""
