"""A campaign's folder: Parquet, manifest and where it all came from."""
