"""Units in S-119 notation: ``ft_s`` for feet per second, ``_deg`` for one per degree."""

import re

from abhv_mc.io.input_error import Refusal
from abhv_mc.io.units import Exponents, parse_unit

_SPELLINGS = {
    "r": "rad",
    "f": "ft",
    "sec": "s",
    "d": "deg",
    "hr": "h",
    "lbm": "lb",
    "nim": "nmi",
    "kn": "kt",
    "knot": "kt",
}
_SYMBOLS = (
    "slug", "kPa", "nmi", "nim", "knot", "lbm", "lbf", "rad", "deg", "min", "sec", "kg", "km", "cm",
    "mm", "ft", "in", "kt", "kn", "Pa", "hr", "lb", "Hz", "N", "W", "m", "s", "h", "r", "d", "f",
)  # fmt: skip  # longest first
_TOKEN = re.compile(f"({'|'.join(_SYMBOLS)})([0-9]?)")
# pattern that also matches spellings such as FT, Deg and LBF
_ANY_CASE = re.compile(_TOKEN.pattern, re.IGNORECASE)
_EXACT = {symbol.lower(): symbol for symbol in reversed(_SYMBOLS)}
_NUMBERS = {"nd": 1.0, "frac": 1.0, "pct": 0.01, "": 1.0}


def parse_s119_unit(text: str) -> tuple[float, Exponents]:
    """Return the factor from a unit to SI, and its exponents. Raise Refusal if unknown."""
    if text.lower() in _NUMBERS:
        return _NUMBERS[text.lower()], (0, 0, 0, 0, 0)
    above, _, below = text.partition("_")
    symbols = [_words(above, text), *(f"/{word}" for word in _words(below, text).split())]
    return parse_unit("1" + "".join(symbols[1:]) if not above else " ".join(symbols))


def _words(text: str, unit: str) -> str:
    """Split a unit into symbols with exponents, for :func:`abhv_mc.io.units.parse_unit`."""
    symbols, position = [], 0
    while position < len(text):
        match = _TOKEN.match(text, position) or _ANY_CASE.match(text, position)
        if match is None:
            raise Refusal(
                f"unknown unit '{unit}'", "a unit of S-119 such as ft_s, slugft2, _deg, pct or nd"
            )
        symbol = match[1] if match[1] in _SYMBOLS else _EXACT[match[1].lower()]
        symbols.append(_SPELLINGS.get(symbol, symbol) + match[2])
        position = match.end()
    return " ".join(symbols)
