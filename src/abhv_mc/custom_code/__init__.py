"""Custom code of users: its text, trust in it, the files that it may read, child processes."""
