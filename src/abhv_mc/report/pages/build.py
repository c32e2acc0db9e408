"""From a campaign's folder to its report: numbers, figures and a page."""

import gc
import hashlib
import json
import shlex
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from abhv_mc.folder.hashes import data_files
from abhv_mc.folder.layout import CampaignFolder, hash_file
from abhv_mc.folder.manifest import Manifest, read_manifest
from abhv_mc.folder.siblings import name_siblings
from abhv_mc.io.input_error import InputError

Stage = Callable[[str], AbstractContextManager[object]]


def hash_files(folder: Path) -> dict[str, str]:
    """SHA-256 of every file that the report is made from, by its path in the folder, as the manifest lists them."""
    paths = CampaignFolder(folder)
    manifest = read_manifest(paths.manifest)
    names = [
        path.relative_to(paths.root).as_posix()
        for path in (paths.campaign, *data_files(paths, manifest))
    ]
    return {name: manifest.files[name] for name in names}


def hash_pages(folder: Path, names: Iterable[str]) -> dict[str, str | None]:
    """SHA-256 of written pages; None for one that is gone."""
    return {name: hash_file(folder / name) if (folder / name).is_file() else None for name in names}


def make_key(folder: Path, baseline: Path | None = None) -> str:
    """What a report follows from: the data and manifests of the folder and its baseline, and the program."""
    import abhv_mc
    from abhv_mc.topics.topic import user_topics

    source = Path(abhv_mc.__file__).parent
    parts = sorted(
        path
        for name in ("report", "statistics", "topics")
        for path in (source / name).rglob("*")
        if path.is_file()
    )
    code = {
        path.relative_to(source).as_posix(): hash_file(path)
        for path in parts
        if path.suffix != ".pyc"
    }
    data: list[Any] = [abhv_mc.__version__, code, hash_file(folder / "manifest.json")]
    data.append([topic.name for topic in user_topics()])
    data += name_siblings(folder, read_manifest(CampaignFolder(folder).manifest))
    if CampaignFolder(folder).failure_map.is_file():
        data.append(hash_file(CampaignFolder(folder).failure_map))
    if baseline is not None:
        data += [baseline.as_posix(), hash_file(baseline / "manifest.json")]
    text = json.dumps(data, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def is_up_to_date(folder: Path, baseline: Path | None = None) -> bool:
    """Whether the page and its figures are there as this program would make them again from the same data."""
    try:
        written = json.loads((folder / "report.json").read_text(encoding="utf-8"))
        made = {**written["pages"], **written["pictures"]}
        known = written["key"] == make_key(folder, baseline) and "report.html" in made
        return bool(known and hash_pages(folder, made) == made)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


SIDES: dict[str | None, tuple[str, ...]] = {"high": ("--above",), "low": ("--below",), None: ()}


def refuse_search(root: Path, manifest: Manifest) -> None:
    """Raise InputError for a search's folder, naming the command that makes its page again."""
    if manifest.search:
        expected = f"the search's own command, which makes its page again from them: {search_command(root, manifest)}"
        raise InputError(
            root, "the flights of a search, of which there is no campaign's report", expected
        )


def search_command(root: Path, manifest: Manifest) -> str:
    """The command that answers the search again from what the folder holds."""
    held = manifest.search or {}
    words = [
        "abhv-mc",
        held["kind"],
        str(root / "campaign.yaml"),
        "--controller",
        held["controller"],
    ]
    if held["kind"] == "worst":
        words += ["--metric", held["metric"], *SIDES[held["bad"]], "--box", f"{held['box']:g}"]
    else:
        words += ["--requirement", held["requirement"], "--target-cov", f"{held['target_cov']:g}"]
    return shlex.join([*words, "--flights", str(held["flights"]), "-o", str(root)])


@contextmanager
def _seldom_collecting() -> Iterator[None]:
    """Figures are made of so many objects that looking for garbage among them takes an eighth of a report's time."""
    held = gc.get_threshold()
    gc.set_threshold(100_000, 20, 20)
    try:
        yield
    finally:
        gc.set_threshold(*held)


@_seldom_collecting()
def build_report(
    folder: Path, baseline: Path | None = None, svg: bool = False, stage: Stage = nullcontext
) -> Path:
    """Write a folder's report and return its page; ``svg``: each figure as SVG, too. Raises InputError."""
    from abhv_mc.folder.flown_campaign import read_flown
    from abhv_mc.folder.layout import write_text
    from abhv_mc.report.numbers.compare import compare_baseline
    from abhv_mc.report.numbers.report_numbers import make_numbers
    from abhv_mc.report.pages.matrix import make_matrix, make_metrics
    from abhv_mc.report.pages.page import PageFigure, make_page
    from abhv_mc.topics.figure_style import write_png, write_svg
    from abhv_mc.topics.metrics import METRICS
    from abhv_mc.topics.registry import make_figures
    from abhv_mc.topics.topic import Models
    from abhv_mc.topics.verdicts import VERDICTS

    refuse_search(folder, read_manifest(CampaignFolder(folder).manifest))
    key = make_key(folder, baseline)  # as it is now: a run may go on meanwhile
    results = read_flown(folder)
    models = Models(results)
    held = compare_baseline(results, baseline) if baseline else None
    with stage("report: statistics"):
        numbers = {**make_numbers(models, held), "files": hash_files(folder)}
    figures_folder = folder / "figures"
    figures_folder.mkdir(exist_ok=True)
    figures, failed = [], []
    with stage("report: figures"):
        for shown, made in make_figures(models).items():
            try:
                for text, figure in made:
                    path = figures_folder / f"{text.name}.png"
                    width, height = write_png(figure, path)
                    if svg:
                        write_svg(figure, path.with_suffix(".svg"))
                    figures.append(PageFigure(text, path, width, height))
            except (
                ArithmeticError,
                AttributeError,
                LookupError,
                RuntimeError,
                TypeError,
                ValueError,
            ) as error:
                failed.append(
                    f"figures of {shown} could not be made ({type(error).__name__}: {error})"
                )
    results.refuse_changes()
    kept = {
        figure.path.with_suffix(kind) for figure in figures for kind in (".png", *[".svg"] * svg)
    }
    for stale in {*figures_folder.glob("*.png"), *figures_folder.glob("*.svg")} - kept:
        stale.unlink(missing_ok=True)  # another report of this folder may do the same
    page = folder / "report.html"
    write_text(CampaignFolder(folder).metrics, make_metrics(models[METRICS]))
    write_text(page, make_page(models, figures, failed, held))
    if results.campaign.requirements:
        write_text(
            CampaignFolder(folder).matrix, make_matrix(models[VERDICTS], results.campaign.metrics)
        )
    pictures = hash_pages(folder, [path.relative_to(folder).as_posix() for path in sorted(kept)])
    numbers |= {"pages": hash_pages(folder, [page.name]), "pictures": pictures, "key": key}
    write_text(folder / "report.json", json.dumps(numbers, indent=1, allow_nan=False) + "\n")
    return page
