"""DAVE-ML models (ANSI/AIAA S-119-2011) read, written as Python functions, checked by their own check shots."""
