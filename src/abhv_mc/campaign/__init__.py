"""Campaigns: the file, the samples, the run that loses nothing, the envelopes, and what is found out afterwards."""

MOST_WORKERS = 1024  # flights in parallel on one machine
