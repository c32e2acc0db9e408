"""Input and output: documents with source locations, units, input errors, atomic writes."""
