"""Custom simulators, which run in processes that are monitored flight by flight."""
