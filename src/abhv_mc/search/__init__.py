"""Searches over a campaign's dispersions, with its executor and results folder."""
