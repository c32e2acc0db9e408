"""Names of controllers as they stand on the command line."""

from abhv_mc.io.input_error import InputError


def parse_names(text: str | None, option: str = "--controllers") -> tuple[str, ...] | None:
    """Names with commas between them; None without the option. Raises InputError for an empty name."""
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise InputError(option, None, None, f"'{text}', which holds an empty name", "names such as tlc,lqr")
    return names
