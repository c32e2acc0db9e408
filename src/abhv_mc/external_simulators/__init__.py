"""User simulators, run in processes that are watched flight by flight."""
