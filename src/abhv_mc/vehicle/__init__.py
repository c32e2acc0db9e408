"""Reading of vehicle files and their tables, and packing for compiled code."""
