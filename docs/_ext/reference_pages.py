"""The pages of ``docs/reference/generated``: made from the code's own tables at every build, so they cannot drift."""

from pathlib import Path
from shutil import rmtree

import command_pages
import key_pages
import table_pages


def make_pages(folder: Path, examples: Path) -> dict[Path, str]:
    """Every generated page by its path below ``folder``; ``examples`` holds what is said of a command by hand."""
    pages = {**command_pages.make(examples), **key_pages.make(), **table_pages.make()}
    return {folder / name: text for name, text in pages.items()}


def write_pages(app) -> None:
    """Write what has changed, and delete what is not made any more."""
    source = Path(app.srcdir) / "reference"
    folder = source / "generated"
    pages = make_pages(folder, source / "commands")
    if folder.exists() and set(folder.rglob("*.md")) - set(pages):
        rmtree(folder)
    for path, text in pages.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}
