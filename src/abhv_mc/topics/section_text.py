"""A topic's section as Markdown, which a terminal shows as it is."""

import re
from collections.abc import Iterator, Sequence

from abhv_mc.topics.section import Bullets, Fold, Heading, Item, Section, Table, Text


def as_markdown(section: Section) -> str:
    """The section's words and tables; figures stay with the page."""
    return "\n\n".join([f"## {section.title}", *_blocks(section.items)])


def _blocks(items: Sequence[Item]) -> Iterator[str]:
    for item in items:
        if isinstance(item, Text):
            yield _escape(item.text)
        elif isinstance(item, Heading):
            yield f"### {_escape(item.text)}"
        elif isinstance(item, Bullets):
            yield "\n".join(f"- {_escape(sentence)}" for sentence in item.sentences)
        elif isinstance(item, Table):
            yield table_markdown(item)
        elif isinstance(item, Fold):
            yield f"### {_escape(item.title)}"
            yield from _blocks(item.items)


def table_markdown(table: Table) -> str:
    """A table, its title above it."""
    rows = [table.heads, ["---"] * len(table.heads), *table.plain_rows()]
    lines = ["| " + " | ".join(_escape(cell).replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join([f"**{_escape(table.caption or table.title)}**", "", *lines])


def _escape(text: str) -> str:
    """A text that no Markdown reader takes for markup; what stands between backticks stays as it is."""
    parts = re.sub(r"\s+", " ", text).split("`")
    return "`".join(part if i % 2 else re.sub(r"([\\*\[\]])", r"\\\1", part.replace("<", "&lt;"))
                    for i, part in enumerate(parts))  # fmt: skip
