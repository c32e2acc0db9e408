"""A campaign's flights in the browser, counted by DuckDB: up to a million of them."""
