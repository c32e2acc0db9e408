"""What is said of bad input; apart from :mod:`abhv_mc.io.documents`, because the command line needs it at once."""

import difflib
import errno
import unicodedata
from collections.abc import Iterable, Sequence
from pathlib import Path

# Words of other programs, and what they are called here.
_SYNONYMS = {
    **dict.fromkeys(("gauss", "gaussian"), "normal"),
    **dict.fromkeys(("std", "stddev", "sd", "standard_deviation"), "sigma"),
    **dict.fromkeys(("min", "minimum", "lower"), "low"),
    **dict.fromkeys(("max", "maximum", "upper"), "high"),
}


class InputError(Exception):
    """Bad input: the place, what was found there and what is expected. The command line prints it and exits 2."""

    def __init__(
        self,
        file: str | Path,
        found: str,
        expected: str,
        line: int | None = None,
        column: int | None = None,
    ) -> None:
        super().__init__(file, found, expected, line, column)
        self.file = str(file)
        self.line = line
        self.column = column
        self.found = found
        self.expected = expected

    def __str__(self) -> str:
        place = ":".join(
            str(part) for part in (self.file, self.line, self.column) if part is not None
        )
        return printable(f"{place}: {_sentence(self.found, self.expected)}")


class InputErrors(InputError):
    """Everything wrong with one input, in order of file and place; its own fields are those of the first."""

    def __init__(self, errors: Sequence[InputError]) -> None:
        errors = sorted(errors, key=lambda error: (error.file, error.line or 0, error.column or 0))
        first = errors[0]
        super().__init__(first.file, first.found, first.expected, first.line, first.column)
        self.args = (tuple(errors),)
        self.errors = tuple(errors)

    def __str__(self) -> str:
        return "\n".join(str(error) for error in self.errors)


class Refusal(ValueError):
    """Raised by a check of one value that does not know the value's place; its caller does.

    ``keys`` lead from the checked value to the part of it that is wrong.
    """

    def __init__(self, found: str, expected: str, keys: tuple[str | int, ...] = ()) -> None:
        super().__init__(found, expected, keys)
        self.found = found
        self.expected = expected
        self.keys = keys

    def __str__(self) -> str:
        return printable(_sentence(self.found, self.expected))


def _sentence(found: str, expected: str) -> str:
    return (
        f"{found}; {expected}"
        if expected.startswith("did you mean")
        else f"{found}; expected {expected}"
    )


def is_exhausted(error: BaseException) -> bool:
    """Return whether an error says that there are too many open files or processes, or too little memory."""
    kinds = (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM)
    return isinstance(error, OSError) and error.errno in kinds


def printable(text: str) -> str:
    """Text from a file for a terminal: what would move its cursor, hide text or turn it around as an escape."""
    return "".join(
        char if is_printable(char) or char == "\n" else ascii(char)[1:-1] for char in text
    )


def is_printable(text: str) -> bool:
    """Whether a terminal shows it as it is; spaces of all scripts are."""
    return all(char.isprintable() or unicodedata.category(char) == "Zs" for char in text)


def one_of(names: Iterable[object], given: object = None) -> str:
    """The choices in words, and which of them a misspelt ``given`` comes nearest to."""
    words = [str(name) for name in names]
    near = [word for word in (_SYNONYMS.get(str(given).lower()),) if word in words]
    if given is not None and not near:
        near = difflib.get_close_matches(str(given), words, n=1)
    if near and len(words) > 30:
        return f"did you mean '{near[0]}'?"
    choices = f"one of {', '.join(words)}" if len(words) != 1 else f"'{words[0]}'"
    return f"{choices} (did you mean '{near[0]}'?)" if near and len(words) > 1 else choices


def describe(value: object) -> str:
    """A value of a document in a few words for ``found``."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return (
            f"a mapping ({', '.join(map(str, list(value)[:3]))}{', ...' if len(value) > 3 else ''})"
        )
    if isinstance(value, (list, tuple)):
        return f"a list of {len(value)}"
    text = str(value) if isinstance(value, (int, float)) else f"'{value}'"
    return text if len(text) <= 80 else text[:76] + "...'"
