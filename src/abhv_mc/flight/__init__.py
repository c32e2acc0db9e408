"""The flight: signals, outcomes, metrics, plans, and the one place that enters the compiled flight."""
