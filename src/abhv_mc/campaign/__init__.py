"""Campaigns: reading and checking the campaign file, and drawing its samples."""

MOST_WORKERS = 1024  # flights in parallel on one machine
