"""Lane-safe mathematics, quaternions, tables and the root finder."""
