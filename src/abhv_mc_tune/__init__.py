"""Tuning: better numbers in a controller's file, compared with the start on fresh flights."""
