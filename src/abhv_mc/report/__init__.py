"""A campaign's report: numbers, figures, page."""
