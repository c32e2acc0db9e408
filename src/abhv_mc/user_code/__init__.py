"""A user's own control law: its file read, checked, compiled apart from the flight, and wired by name."""
