"""Elementary functions for loops over lanes, quaternions, table look-up and root finding."""
