"""Which installed packages a user's Python code imports, with their versions: for the manifest."""

import ast
import sys
from collections.abc import Iterable, Iterator
from importlib import metadata

from abhv_mc.user_code.source import UserSource


def find_package_versions(sources: Iterable[UserSource]) -> dict[str, str]:
    """Version of each installed package that the texts import, by its name; read from the texts, which are not run."""
    expected = {name for source in sources for name in _imported(source)} - sys.stdlib_module_names - {"abhv_mc"}
    if not expected:
        return {}
    distributions = metadata.packages_distributions()
    return {package: metadata.version(package) for name in sorted(expected) for package in distributions.get(name, ())}


def _imported(source: UserSource) -> Iterator[str]:
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
