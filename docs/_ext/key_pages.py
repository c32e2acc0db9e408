"""A page of keys for each kind of input file."""


def make() -> dict[str, str]:
    """The pages by their path."""
    return {}
