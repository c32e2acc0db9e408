"""HTML pages, PDF files and files for other programs, made from the numbers of a report."""
