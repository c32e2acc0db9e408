"""Input and output: documents with source locations, units, errors, and atomic writes."""
