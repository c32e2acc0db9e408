"""Print-ready figures: functions that return matplotlib figures of arrays, without pyplot."""
