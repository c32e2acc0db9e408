"""Interactive browser view of up to a million flights, with counts computed by DuckDB."""
