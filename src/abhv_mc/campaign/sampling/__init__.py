"""What is flown: designs, marginal distributions, correlation."""
