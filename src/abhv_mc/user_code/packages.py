"""Which installed packages a user's Python code imports, with their versions: for the manifest."""

import ast
import sys
from collections.abc import Iterable, Iterator
from importlib import metadata

from abhv_mc.user_code.source import OwnSource


def find_package_versions(sources: Iterable[OwnSource]) -> dict[str, str]:
    """Version of each installed package that the texts import, by its name; read from the texts, which are not run."""
    wanted = {name for source in sources for name in _imported(source)} - sys.stdlib_module_names - {"abhv_mc"}
    if not wanted:
        return {}
    distributions = metadata.packages_distributions()
    return {package: metadata.version(package) for name in sorted(wanted) for package in distributions.get(name, ())}


def _imported(source: OwnSource) -> Iterator[str]:
    texts = [content for name, content in source.files if name.endswith(".py")]
    for text in texts or [source.text.encode()]:
        try:
            nodes = list(ast.walk(ast.parse(text)))
        except (SyntaxError, ValueError):  # a template, perhaps: nobody imports it
            continue
        for node in nodes:
            if isinstance(node, ast.Import):
                yield from (alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                yield node.module.partition(".")[0]
