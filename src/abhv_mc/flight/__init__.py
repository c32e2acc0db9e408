"""The flight: signals, outcomes, metrics and the compiled engine, many flights abreast."""
