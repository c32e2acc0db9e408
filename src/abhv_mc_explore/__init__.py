"""Interactive browser view of up to a million flights, which DuckDB counts."""
