"""Searches over a campaign's dispersions, with their executor and results folder."""
