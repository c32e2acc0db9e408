"""Compiled equations of motion of a vehicle, with actuators, failures and atmosphere."""
