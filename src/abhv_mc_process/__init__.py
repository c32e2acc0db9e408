"""Control laws in programs, which run in processes of their own."""
