"""From a campaign's folder to its report: numbers, figures and a page."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from abhv_mc.report.results import read_results

Format = Literal["html", "md"]


def hash_files(folder: Path) -> dict[str, str]:
    """SHA-256 of every file that the report is made from, by its path in the folder."""
    names = ["campaign.yaml", "samples.parquet", "envelopes.parquet", "nominal.parquet", "reference.parquet"]
    paths = [folder / name for name in names]
    paths += [*sorted((folder / "flights").glob("*.parquet")), *sorted((folder / "histories").glob("*.parquet"))]
    return {path.relative_to(folder).as_posix(): _hash_file(path) for path in paths if path.is_file()}


def hash_pages(folder: Path, names: Iterable[str]) -> dict[str, str | None]:
    """SHA-256 of written pages; None for one that is gone."""
    return {name: _hash_file(folder / name) if (folder / name).is_file() else None for name in names}


def _hash_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _read_pages(path: Path, numbers: dict[str, Any]) -> dict[str, Any]:
    """The pages that an earlier report with the same numbers names."""
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
        pages: dict[str, Any] = held.pop("pages", {})
        for name in ("figures", "key"):
            held.pop(name, None)
    except (OSError, ValueError, AttributeError):
        return {}
    return pages if held == json.loads(json.dumps(numbers)) else {}


def make_key(folder: Path) -> str:
    """What a report follows from: the folder's data and manifest, and the program that makes it."""
    import abhv_mc

    source = Path(abhv_mc.__file__).parent
    parts = sorted(path for name in ("report", "statistics") for path in (source / name).rglob("*") if path.is_file())
    code = {path.relative_to(source).as_posix(): _hash_file(path) for path in parts if path.suffix != ".pyc"}
    manifest = folder / "manifest.json"
    held = _hash_file(manifest) if manifest.is_file() else None
    text = json.dumps([abhv_mc.__version__, code, hash_files(folder), held], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def is_up_to_date(folder: Path, page: str = "report.html") -> bool:
    """Whether the page and its figures are there as this program would make them again from the same data."""
    try:
        written = json.loads((folder / "report.json").read_text(encoding="utf-8"))
        pages, figures = written["pages"], written["figures"]
        return bool(
            written["key"] == make_key(folder)
            and page in pages
            and hash_pages(folder, pages) == pages
            and all((folder / "figures" / name).is_file() for name in figures)
        )
    except (OSError, ValueError, KeyError, TypeError):
        return False


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
    page = folder / f"report.{format}"
    write_text(
        page, make_page(results, numbers, figures) if format == "html" else make_markdown(results, numbers, figures)
    )
    report = folder / "report.json"
    names = [*_read_pages(report, numbers), page.name]
    extras = {"figures": sorted(path.name for path in kept), "key": make_key(folder)}
    numbers = {**numbers, "pages": hash_pages(folder, dict.fromkeys(names)), **extras}
    write_text(report, json.dumps(numbers, indent=1, allow_nan=False) + "\n")
    return page
