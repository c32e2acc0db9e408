"""Custom control laws, channels and vehicle functions: read, checked and compiled."""
