"""Files in and out: documents with places, units, what is said of bad input, atomic writes."""
