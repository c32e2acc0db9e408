"""Linear models of the closed loop and their stability margins."""
