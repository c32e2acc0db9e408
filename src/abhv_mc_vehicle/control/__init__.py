"""Mission reference, guidance trim, and controllers with the design of their gains."""
