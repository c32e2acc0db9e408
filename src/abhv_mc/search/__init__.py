"""Searches on a campaign's executor: its dispersions as points, its flights as values, its folder as the memory."""
