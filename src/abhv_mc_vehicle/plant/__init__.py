"""Dispersible parameters, control effectiveness and trim of the plant."""
