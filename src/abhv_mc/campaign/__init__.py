"""Reading and checking of campaign files, and drawing of samples."""

MOST_WORKERS = 1024  # maximum number of blocks of flights computed in parallel on one machine
