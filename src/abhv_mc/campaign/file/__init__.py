"""Reading and checking of the campaign file and the files that it names."""
