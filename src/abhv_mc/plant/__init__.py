"""What a campaign may disperse, slopes for control allocation, and trim."""
