"""Reading and checking of campaign files and the files that they name."""
