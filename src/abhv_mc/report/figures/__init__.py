"""Print-ready figures: functions from arrays to matplotlib figures, without pyplot."""
