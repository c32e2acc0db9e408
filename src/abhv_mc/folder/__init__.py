"""A campaign's folder: Parquet, manifest, plans, provenance. Every file is written aside and renamed."""
