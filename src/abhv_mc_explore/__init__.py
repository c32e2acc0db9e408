"""Interactive view of up to a million flights in the browser, counted by DuckDB."""
