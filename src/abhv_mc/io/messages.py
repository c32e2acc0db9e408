"""Printed messages: errors for invalid input, numbers, counts and lists of names, notices.

The module is separate from :mod:`abhv_mc.io.documents` because the command line imports it on every
start.
"""

import difflib
import errno
import sys
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

THIN = "\N{NARROW NO-BREAK SPACE}"
_UNGROUPED = 10_000  # numbers below this are printed without spaces between digits

# Names used by other programs, mapped to the names used by abhv-mc.
_SYNONYMS = {
    **dict.fromkeys(("gauss", "gaussian"), "normal"),
    **dict.fromkeys(("std", "stddev", "sd", "standard_deviation"), "sigma"),
    **dict.fromkeys(("min", "minimum", "lower"), "low"),
    **dict.fromkeys(("max", "maximum", "upper"), "high"),
}


def grouped_digits(number: float, decimals: int = 0) -> str:
    """Format a number; from 10 000 on, narrow spaces separate groups of three digits.

    Examples
    --------
    >>> grouped_digits(1500)
    '1500'
    >>> grouped_digits(15000).split()
    ['15', '000']
    """
    separator = "," if abs(round(number, decimals)) >= _UNGROUPED else ""
    return f"{number:{separator}.{decimals}f}".replace(",", THIN)


def counted(count: int, noun: str) -> str:
    """Return a count with its noun in the singular or plural, such as '1 flight' or '2 flights'.

    The last word of `noun` becomes plural; for other plurals, pass both forms as 'axis/axes'.
    """
    singular, _, plural = noun.partition("/")
    return f"{grouped_digits(count)} {singular if count == 1 else plural or f'{singular}s'}"


def joined(items: Sequence[str], conjunction: str = "and") -> str:
    """Join items as 'a', 'a and b' or 'a, b and c'."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {conjunction} {items[-1]}"


def quoted(names: Iterable[object], conjunction: str = "and") -> str:
    """Join names in quotation marks as "'a', 'b' and 'c'"; without names, return 'none'."""
    return joined([f"'{name}'" for name in names], conjunction) or "none"


def notify(text: str) -> None:
    """Print a line on standard error immediately."""
    print(text, file=sys.stderr, flush=True)


class InputError(Exception):
    """Error for invalid input, with source location, value found and value expected.

    The command line prints the error and exits with code 2.

    Attributes
    ----------
    file, line, column
        Source location; line and column are None if they are unknown.
    found, expected
        Value found and value expected.

    Examples
    --------
    >>> try:
    ...     abhv_mc.fly("level", dispersions={"aero.dragg": 1.1})
    ... except abhv_mc.InputError as error:
    ...     print(error)
    dispersions: unknown parameter 'aero.dragg'; did you mean 'aero.drag'?
    """

    def __init__(
        self,
        file: str | Path,
        problem: str,
        expected: str,
        line: int | None = None,
        column: int | None = None,
    ) -> None:
        super().__init__(file, problem, expected, line, column)
        self.file = str(file)
        self.line = line
        self.column = column
        self.found = problem
        self.expected = expected

    def __str__(self) -> str:
        items = (self.file, self.line, self.column)
        location = ":".join(str(item) for item in items if item is not None)
        return printable(f"{location}: {_sentence(self.found, self.expected)}")


class InputErrors(InputError):
    """Error that contains all problems of one input, sorted by file and location.

    Attributes
    ----------
    errors
        Each problem as an :class:`InputError`; the other attributes are those of the first problem.

    Examples
    --------
    >>> try:
    ...     abhv_mc.Campaign.make({"name": "study", "missing": "turn", "runs": 0})
    ... except abhv_mc.InputErrors as problems:
    ...     messages = [str(error) for error in problems.errors]
    """

    def __init__(self, errors: Sequence[InputError]) -> None:
        errors = sorted(errors, key=lambda error: (error.file, error.line or 0, error.column or 0))
        first = errors[0]
        super().__init__(first.file, first.found, first.expected, first.line, first.column)
        self.args = (tuple(errors),)
        self.errors = tuple(errors)

    def __str__(self) -> str:
        return "\n".join(str(error) for error in self.errors)


class Refusal(ValueError):
    """Error raised by a check that does not know the source location of the checked value.

    The caller adds the location. ``keys`` is the path from the checked value to the invalid item.
    """

    def __init__(self, problem: str, expected: str, keys: tuple[str | int, ...] = ()) -> None:
        super().__init__(problem, expected, keys)
        self.found = problem
        self.expected = expected
        self.keys = keys

    def __str__(self) -> str:
        return printable(_sentence(self.found, self.expected))


def _sentence(problem: str, expected: str) -> str:
    word = "" if expected.startswith("did you mean") else "expected "
    return f"{problem}; {word}{expected}"


def is_exhausted(error: BaseException) -> bool:
    """Return whether the error means that file handles, processes or memory are exhausted."""
    kinds = (errno.EMFILE, errno.ENFILE, errno.EAGAIN, errno.ENOMEM)
    return isinstance(error, OSError) and error.errno in kinds


def printable(text: str) -> str:
    """Return text with control characters escaped, for printing to a terminal."""
    return "".join(
        char if is_printable(char) or char == "\n" else ascii(char)[1:-1] for char in text
    )


def is_printable(text: str) -> bool:
    """Return whether a terminal displays the text unchanged; all kinds of spaces are allowed."""
    return all(char.isprintable() or unicodedata.category(char) == "Zs" for char in text)


def one_of(names: Iterable[object], misspelt: object = None) -> str:
    """Return the choices as text, with a suggestion for a misspelt name."""
    options = [str(name) for name in names]
    near = [word for word in (_SYNONYMS.get(str(misspelt).lower()),) if word in options]
    if misspelt is not None and not near:
        near = difflib.get_close_matches(str(misspelt), options, n=1)
    if near and len(options) > 30:
        return f"did you mean '{near[0]}'?"
    choices = quoted(options, "or")
    return f"{choices} (did you mean '{near[0]}'?)" if near and len(options) > 1 else choices


def describe(value: object) -> str:
    """Return a short description of a value for error messages."""
    if value is None or isinstance(value, bool):
        return {None: "nothing", True: "true", False: "false"}[value]
    if isinstance(value, dict):
        if not value:
            return "an empty mapping"
        keys = [f"'{key}'" for key in list(value)[:3]]
        keys += [f"{len(value) - 3} more"] if len(value) > 3 else []
        return f"a mapping with the key{'s' if len(value) > 1 else ''} {joined(keys)}"
    if isinstance(value, (list, tuple)):
        return f"a list of length {len(value)}" if value else "an empty list"
    text = str(value) if isinstance(value, (int, float)) else f"'{value}'"
    return text if len(text) <= 80 else text[:76] + "...'"


def found_value(value: object) -> str:
    """Return the text of an error about an unexpected value, such as "found 3"."""
    return f"found {describe(value)}"


def check_names(
    argument: str | Path, names: Iterable[str], choices: Iterable[str], noun: str = "name"
) -> None:
    """Raise InputError for a name that is not among ``choices``, or appears twice."""
    previous, choices = set[str](), tuple(choices)
    for name in names:
        if name not in choices or name in previous:
            problem = f"'{name}' appears twice" if name in choices else f"unknown {noun} '{name}'"
            raise InputError(argument, problem, one_of(choices, name))
        previous.add(name)


def check_mapping(value: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return the value. Raise InputError if it is not a mapping."""
    if not isinstance(value, Mapping):
        raise InputError(name, found_value(value), "a mapping")
    return value
