"""State, forces and equations of motion of a packed vehicle, its actuators, its failures and the air around it."""
