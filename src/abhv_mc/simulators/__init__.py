"""What flies: our own simulator (plans of a vehicle under control, and the kernel that flies them)."""
