"""Campaigns: reading and checking campaign files, and drawing samples."""

MOST_WORKERS = 1024  # maximum number of parallel blocks on one machine
