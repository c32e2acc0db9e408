"""The proof: the product's own plant against check-cases, references and invariants, as rows of one table."""
