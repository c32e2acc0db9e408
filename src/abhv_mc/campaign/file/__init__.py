"""The campaign file and the files that it names: read, checked, resolved."""
