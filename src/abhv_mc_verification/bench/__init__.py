"""Speed of the flight on this machine, relative to the machine's peak."""
