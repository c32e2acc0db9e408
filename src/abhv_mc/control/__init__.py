"""Mission reference, guidance trim and the control laws, with the design of their gains."""
