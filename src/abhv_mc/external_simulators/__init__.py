"""Custom simulators, run in processes that are monitored flight by flight."""
