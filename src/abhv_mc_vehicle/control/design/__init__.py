"""Controller design before a flight: reference, nominal controls, trim tables and gains."""
