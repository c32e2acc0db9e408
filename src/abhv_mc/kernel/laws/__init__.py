"""Compiled control laws, for one control tick in lanes, and look-up of trim tables."""
