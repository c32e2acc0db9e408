"""Where two documents of numbers differ."""

import json
from collections.abc import Iterator
from typing import Any


def differences(written: Any, remade: Any, place: str = "", where: str = "the report") -> Iterator[str]:
    """Where two documents differ, in the order of the written one: 'a.b[2]: 1.5 in the report, 1.6 from the data'."""
    if isinstance(written, dict) and isinstance(remade, dict):
        for key in written:
            inside = f"{place}.{key}" if place else str(key)
            if key in remade:
                yield from differences(written[key], remade[key], inside, where)
            else:
                yield f"{inside}: in {where}, but not in the data"
        yield from (f"{place}.{key}: in the data, but not in {where}" for key in remade if key not in written)
    elif isinstance(written, list) and isinstance(remade, list) and len(written) == len(remade):
        for i, (mine, theirs) in enumerate(zip(written, remade, strict=True)):
            yield from differences(mine, theirs, f"{place}[{i}]", where)
    elif written != remade:
        yield f"{place}: {_short(written)} in {where}, {_short(remade)} from the data"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
