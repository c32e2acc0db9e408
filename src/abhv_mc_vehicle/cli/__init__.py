"""Commands of the vehicle: single flights, trims, linear models, margins and lists."""
