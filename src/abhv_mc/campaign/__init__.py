"""Campaigns: the file, the samples, the blocks of flights and the run that loses nothing."""
