"""Vehicle files and their tables, packed for compiled code."""
