"""Functions that plot arrays in print-ready matplotlib figures, without pyplot."""
