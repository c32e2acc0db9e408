"""The vehicle file and its packed tables."""
