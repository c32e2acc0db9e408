"""Compiled control laws, one control tick in lanes, and their look-up of trim tables."""
