"""HTML pages, PDF files and files for other programs, created from a report's numbers."""
