"""A regular expression for quantities of one dimension, with which an editor checks them while they are typed.

It knows the usual ways to write a unit: one symbol of that dimension ('Pa', 'kt'), one derived unit over a base unit
('MW/m2'), or a product of base units in the order mass, length, angle, time, divided by others ('kg m2', 'ft/s',
'1/s'). The program itself reads more than that.
"""

from collections.abc import Mapping

NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"  # a plain decimal one; \d knows all scripts
_ORDER = (1, 0, 3, 2)  # of the exponents of metre, kilogram, second, radian in a product
_POWERS = {1: "", 2: r"(?:\^?2|²)", 3: r"(?:\^?3|³)"}

Exponents = tuple[int, int, int, int]


def quantity_pattern(exponents: Exponents, symbols: Mapping[str, Exponents]) -> str:
    """A pattern (ECMA 262) for a number with a unit of these exponents, written with these symbols."""
    alone = [symbol for symbol, own in symbols.items() if own == exponents]
    bases = [_alternatives([s for s, own in symbols.items() if own == _base(i)]) for i in range(4)]
    over = [bases[i] + _POWERS[exponents[i]] for i in _ORDER if exponents[i] > 0]
    under = [bases[i] + _POWERS[-exponents[i]] for i in _ORDER if exponents[i] < 0]
    units = [_alternatives(alone)] if alone else []
    for derived in sorted({own for own in symbols.values() if own not in {_base(i) for i in range(4)} and any(own)}):
        too_many = [derived[i] - exponents[i] for i in range(4)]
        place = max(range(4), key=lambda i: abs(too_many[i]))
        if too_many[place] in _POWERS and sum(map(abs, too_many)) == too_many[place]:
            names = _alternatives([symbol for symbol, own in symbols.items() if own == derived])
            units.append(rf"{names}\s?/\s?{bases[place]}{_POWERS[too_many[place]]}")
    if sum(map(abs, exponents)) > 1 or under:
        units.append(r"[ *·]".join(over) + "".join(r"\s?/\s?" + part for part in under) if over else
                     r"1?\s?" + r"\s?".join("/" + part for part in under))  # fmt: skip
    return rf"^\s*{NUMBER}\s*(?:{'|'.join(units)})\s*$"


def _base(place: int) -> Exponents:
    first, second, third, fourth = (int(i == place) for i in range(4))
    return first, second, third, fourth


def _alternatives(symbols: list[str]) -> str:
    return f"(?:{'|'.join(sorted(symbols, key=len, reverse=True))})"
