"""What is said of a campaign: one room for each topic, its numbers, figures, sentences and section."""
