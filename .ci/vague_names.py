"""Warn of names that denote no thing, such as `found` or `part`: python .ci/vague_names.py DIR...

Prints the place of each and their share of all bound names. Never fails: a name can be right where
it is. Names that are right everywhere, such as an argument of a public function, are in
``ALLOWED``.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

VAGUE = {
    *(
        "apart",
        "asked",
        "at",
        "back",
        "each",
        "found",
        "given",
        "held",
        "here",
        "kept",
        "known",
        "made",
    ),
    *("more", "of", "one", "others", "part", "place", "places", "reached", "rest", "said", "shown"),
    *("there", "told", "wanted", "whole", "wish", "words"),
}
ALLOWED = {"of"}  # the metric of a channel, a key of campaign files


def bound_names(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and name of each variable and argument that a file binds."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg


def main(folders: list[str]) -> None:
    """Print the vague names below some folders."""
    number = 0
    vague = []
    for path in sorted(path for folder in folders for path in Path(folder).rglob("*.py")):
        for line, name in bound_names(path):
            number += 1
            if name in VAGUE - ALLOWED:
                vague.append(f"{path}:{line}: {name}")
    print(*vague, f"vague names: {len(vague)} of {number}", sep="\n")


if __name__ == "__main__":
    main(sys.argv[1:])
