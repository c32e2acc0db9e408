"""Design before the flight: reference, nominal controls along it, trim tables and gains."""
