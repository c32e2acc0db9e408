"""What is asked of a flown campaign: replay, explanation, other distributions."""
