"""Searches over a campaign's dispersions, and the results folders of searches."""
