"""Reading, checking and compilation of custom laws, channels and vehicle functions."""
