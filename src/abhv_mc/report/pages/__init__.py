"""HTML pages, PDF and files for other programs, made from the numbers."""
