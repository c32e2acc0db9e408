"""A campaign's folder: Parquet, manifest, plans, provenance. Files are written under a temporary name and renamed."""
