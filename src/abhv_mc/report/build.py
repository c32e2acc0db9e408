"""From a campaign's folder to its report: numbers, figures and a page."""

import hashlib
import json
from pathlib import Path
from typing import Literal

from abhv_mc.report.results import read_results

Format = Literal["html", "md"]


def hash_files(folder: Path) -> dict[str, str]:
    """SHA-256 of every file that the report is made from, by its path in the folder."""
    names = ["campaign.yaml", "samples.parquet", "envelopes.parquet", "nominal.parquet", "reference.parquet"]
    paths = [folder / name for name in names]
    paths += [*sorted((folder / "flights").glob("*.parquet")), *sorted((folder / "histories").glob("*.parquet"))]
    hashes = {}
    for path in paths:
        if path.is_file():
            with path.open("rb") as file:
                hashes[path.relative_to(folder).as_posix()] = hashlib.file_digest(file, "sha256").hexdigest()
    return hashes


def build_report(folder: Path, format: Format = "html") -> Path:  # noqa: A002
    """Write `report.json`, `figures/*.png` and `report.html` (or `report.md`) into a campaign's folder.

    Needs nothing but what the campaign wrote there. Returns the path of the page.
    Raises InputError where a file is missing or unreadable.
    """
    from abhv_mc.report.figures.style import write_png
    from abhv_mc.report.gallery import make_figures
    from abhv_mc.report.numbers import make_numbers
    from abhv_mc.report.page import PageFigure, make_markdown, make_page
    from abhv_mc.store.folder import write_text

    results = read_results(folder)
    numbers = {**make_numbers(results), "files": hash_files(folder)}
    figures_folder = folder / "figures"
    figures_folder.mkdir(exist_ok=True)
    figures = []
    for text, figure in make_figures(results, numbers):
        path = figures_folder / f"{text.name}.png"
        width, height = write_png(figure, path)
        figures.append(PageFigure(text, path, width, height))
    kept = {figure.path for figure in figures}
    for stale in figures_folder.glob("*.png"):
        if stale not in kept:
            stale.unlink()
    write_text(folder / "report.json", json.dumps(numbers, indent=1, allow_nan=False) + "\n")
    page = folder / f"report.{format}"
    write_text(
        page, make_page(results, numbers, figures) if format == "html" else make_markdown(results, numbers, figures)
    )
    return page
