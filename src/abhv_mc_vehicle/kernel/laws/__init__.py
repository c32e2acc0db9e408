"""Compiled control laws for one control tick in all lanes, and look-up of trim tables."""
