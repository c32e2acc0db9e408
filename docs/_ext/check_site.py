"""Check of the built site.

Each internal link must have its page and anchor, and no page may load an external resource.
"""

from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADED = {
    ("script", "src"),
    ("link", "href"),
    ("img", "src"),
    ("iframe", "src"),
    ("source", "src"),
}


class _Page(HTMLParser):
    """The anchors of a page, its links, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors, self.links, self.loaded = {""}, [], []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            elif (tag, name) in _LOADED and value:
                self.loaded.append(value)
            elif name == "href" and value:
                self.links.append(value)


def find_faults(site: Path) -> Iterator[str]:
    """Return the errors of the pages below a folder, one sentence each."""
    pages = {
        path: _Page(path) for path in sorted(site.rglob("*.html")) if "_static" not in path.parts
    }
    for path, page in pages.items():
        place = path.relative_to(site)
        for target in page.loaded:
            if urlsplit(target).netloc:
                yield f"{place} loads {target}"
        for target in {*page.links, *page.loaded}:
            parts = urlsplit(target)
            if parts.scheme or parts.netloc:
                continue
            aim = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if not aim.exists():
                yield f"{place} links to {target}, which does not exist"
            elif aim in pages and unquote(parts.fragment) not in pages[aim].anchors:
                yield f"{place} links to {target}, an anchor that does not exist"


def check(app, error) -> None:
    """Fail the build where something is wrong."""
    if error is None and app.builder.format == "html":
        faults = list(find_faults(Path(app.outdir).resolve()))
        if faults:
            raise SystemExit("\n".join(faults))


def setup(app) -> dict[str, bool]:
    """Register the extension with Sphinx."""
    app.connect("build-finished", check, priority=900)  # when everything else has been written
    return {"parallel_read_safe": True, "parallel_write_safe": True}
