"""The campaign: its file, its samples and how they are flown in blocks."""
