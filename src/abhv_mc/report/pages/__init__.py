"""Pages, made of the numbers."""
