"""Records of flights: signals, metrics, outcomes, parameters and blocks of results."""
