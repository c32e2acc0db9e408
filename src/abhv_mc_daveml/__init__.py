"""Import of DAVE-ML models (ANSI/AIAA S-119-2011) as Python functions."""
