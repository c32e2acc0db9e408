"""Every number of a report, as plain data."""
