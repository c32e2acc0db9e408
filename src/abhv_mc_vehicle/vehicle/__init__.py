"""Reading of vehicle files and their tables, and conversion to arrays for compiled code."""
