"""Mathematics for loops over lanes, quaternions, table look-up and a root finder."""
