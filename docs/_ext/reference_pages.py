"""Pages of ``docs/reference/generated``.

They are generated from the code's tables at every build, so they stay up to date.
"""

from pathlib import Path
from shutil import rmtree

import command_pages
import key_pages
import table_pages


def make_pages(folder: Path, examples: Path) -> dict[Path, str]:
    """Generate all reference pages by their path below ``folder``.

    ``examples`` has the hand-written text of each command.
    """
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
    """Register the extension with Sphinx."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}
