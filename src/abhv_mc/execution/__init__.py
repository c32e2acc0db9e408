"""Execution of campaigns: setup, blocks of flights, workers, retries and progress."""
