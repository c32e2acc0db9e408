"""One HTML page that opens offline: sentences that answer, figures with captions, tables."""

import base64
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from abhv_mc.folder.layout import write_text
from abhv_mc.topics.figure_style import write_png


@dataclass(frozen=True)
class Shown:
    """A figure and its words."""

    name: str
    title: str
    caption: str
    figure: Figure


SHORT, LONG, CODE = "short", "long", "code"  # cells that stay on one line, that break, that are typed as they stand


@dataclass(frozen=True)
class Table:
    """A table and its words."""

    title: str
    caption: str
    heads: tuple[str, ...]
    rows: list[list[str]]
    kinds: tuple[str, ...]  # of the columns


def write_answer_page(
    path: Path,
    title: str,
    kicker: str,
    answers: list[str],
    shown: list[Shown],
    tables: list[Table],
    folder: Path | None = None,
) -> Path:
    """Write the page, and its figures into ``folder``, by default `figures` beside it; returns the page's path."""
    folder = folder or path.parent / "figures"
    figures = []
    for one in shown:
        file = folder / f"{one.name}.png"
        width, height = write_png(one.figure, file)
        image = base64.b64encode(file.read_bytes()).decode("ascii")
        source = Markup(f"data:image/png;base64,{image}")  # noqa: S704  letters of base64 only
        figures.append(
            {"name": one.name, "title": one.title, "caption": one.caption, "source": source}
            | {"width": width, "height": height}
        )
    loader = PackageLoader("abhv_mc.report.pages", "template")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
    style = loader.get_source(environment, "style.css")[0]
    page = environment.get_template("search.html.j2").render(
        title=title,
        kicker=kicker,
        answers=answers,
        figures=figures,
        tables=tables,
        style=Markup(style),  # noqa: S704  our own file
    )
    write_text(path, page)
    return path
