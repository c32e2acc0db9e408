"""Help as a person reads it: a flag has no type, a number no range, a paragraph no line ends of its own."""

from inspect import cleandoc
from typing import Any

from typer.core import TyperCommand, TyperGroup

_SHORT = {"bool": "", "int": "N", "float": "X", "str": "TEXT"}


def _shorten(parameters: list[Any]) -> list[Any]:
    for each in parameters:
        if each.param_type_name == "option" and each.metavar is None and not each.type_descriptor.is_choice:
            each.metavar = _SHORT.get(each.bare_type())
            each._get_number_range_help_str = lambda: None  # beside it an option's own name was cut
    return parameters


def _flow(text: str | None) -> str | None:
    """Paragraphs without line ends inside."""
    return text and "\n\n".join(" ".join(part.split()) for part in cleandoc(text).split("\n\n"))


class Command(TyperCommand):
    """A command with such help."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{**options, "help": _flow(options.get("help"))})

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, flags without a type."""
        return _shorten(super().get_params(ctx))


class Group(TyperGroup):
    """A group of commands with such help."""

    def get_params(self, ctx: Any) -> list[Any]:
        """The parameters, flags without a type."""
        return _shorten(super().get_params(ctx))
