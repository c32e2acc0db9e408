"""How it is flown: setup, blocks of flights, workers, retries, progress, the order of work."""
