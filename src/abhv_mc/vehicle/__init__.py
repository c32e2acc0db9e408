"""Vehicle files and their packed tables."""
