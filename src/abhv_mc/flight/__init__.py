"""The flight: signals, outcomes, metrics and the compiled kernel that flies them in batched lanes."""
