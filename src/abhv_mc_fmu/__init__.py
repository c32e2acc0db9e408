"""Control laws as FMUs for co-simulation (FMI 2.0 and 3.0)."""
