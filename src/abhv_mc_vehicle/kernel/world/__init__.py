"""Models of the Earth, the atmosphere and gusts."""
