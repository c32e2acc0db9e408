"""A flight from its start to its end: measurement, law, plant, metrics, samples."""
