"""One flight, trim or linear model, as Python and the command line ask for it: inputs to values."""
