"""Print-ready figures: functions that plot arrays in matplotlib figures, without pyplot."""
