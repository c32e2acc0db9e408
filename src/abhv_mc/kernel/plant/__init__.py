"""Equations of motion of a packed vehicle, with its actuators, failures and air."""
