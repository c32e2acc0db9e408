"""Controller design before the flight: reference, nominal controls, trim tables and gains."""
