"""The commands: one file each, nothing but parsing, calling and printing. What is heavy is imported in the body."""
