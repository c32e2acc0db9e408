"""A page that answers one question and opens offline, of a search or a comparison: a section's values in a frame."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from markupsafe import Markup

from abhv_mc.folder.layout import write_text
from abhv_mc.report.pages.page import PageFigure, embed, make_environment
from abhv_mc.topics.figure_style import write_png
from abhv_mc.topics.section import Cell, Section, Table
from abhv_mc.topics.topic import Drawn


@dataclass(frozen=True)
class Answer:
    """What a search or a comparison says: a page and the terminal draw the same section."""

    title: str
    kicker: str
    section: Section


def make_table(title: str, caption: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    """A table of texts; what stands between backticks is a command."""
    cells = tuple(tuple(Cell(text) for text in row) for row in rows)
    return Table(title, tuple(heads), (cells,), f"{title}. {caption}", numbers=False)


def write_section_page(answer: Answer, drawn: Iterable[Drawn], path: Path, folder: Path | None = None) -> Path:
    """Write the page, and its figures into ``folder``, by default `figures` beside it; returns the page's path."""
    folder, figures = folder or path.parent / "figures", {}
    for text, figure in drawn:
        file = folder / f"{text.name}.png"
        figures[text.name] = embed(PageFigure(text, file, *write_png(figure, file)))
    style = Markup((files("abhv_mc.report.pages") / "template/style.css").read_text("utf-8"))  # noqa: S704  our own file
    page = make_environment().get_template("answer.html.j2").render(answer=answer, figure_of=figures, style=style)
    write_text(path, page)
    return path
