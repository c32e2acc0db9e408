"""Results folders in object storage, and flights on a Dask cluster."""
