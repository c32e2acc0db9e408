"""Results folder of a campaign: Parquet tables, manifest, plans and provenance."""
