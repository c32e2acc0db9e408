"""The compiled control laws, one control tick in lanes, and what they look up in flight."""
