"""Numbers and sentences of reports, as plain data."""
