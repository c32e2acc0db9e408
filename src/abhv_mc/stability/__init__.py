"""Linear models of the flight under control and their stability margins."""
