"""Campaigns: the file, read and checked, and the samples drawn for it."""

MOST_WORKERS = 1024  # flights in parallel on one machine
