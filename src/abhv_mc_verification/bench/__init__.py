"""How fast the flight is on this machine, and how close that is to what the machine can do."""
