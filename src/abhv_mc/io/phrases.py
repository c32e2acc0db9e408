"""Phrases of printed sentences: numbers with grouped digits, counts, lists of names; notices."""

import sys
from collections.abc import Iterable, Sequence

THIN = "\N{NARROW NO-BREAK SPACE}"
_UNGROUPED = 10_000  # numbers below this are printed without spaces between digits


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
