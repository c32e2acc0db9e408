"""A user's simulator: what flies it, watched flight by flight."""
