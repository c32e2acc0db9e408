"""Single flights, trims and linear models for Python and the command line."""
