"""Earth, atmosphere and gusts."""
