"""From a campaign's folder to its report: numbers, figures and a page."""

import gc
import hashlib
import json
import shlex
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from abhv_mc.folder.flights import Digest, parse_block_name, read_digest
from abhv_mc.folder.hashes import data_files
from abhv_mc.folder.layout import CampaignFolder, hash_file
from abhv_mc.folder.manifest import Manifest, read_manifest
from abhv_mc.folder.pooled_campaigns import suggest_merge
from abhv_mc.io.input_error import InputError

Stage = Callable[[str], AbstractContextManager[object]]


def hash_files(folder: Path) -> dict[str, str]:
    """Return what a report is made from: the SHA-256 of files by path, and the digest of each controller's rows.

    How the rows are divided into block files says nothing about them: a block that is computed again may have another
    name.
    """
    paths = CampaignFolder(folder)
    manifest = read_manifest(paths.manifest)
    hashes, digests = {}, dict[str, Digest]()
    for path in (paths.campaign, *data_files(paths, manifest)):
        if path.parent == paths.flights:
            controller = parse_block_name(path)[0]
            digests[controller] = digests.get(controller, Digest()) + read_digest(path)
        else:
            name = path.relative_to(paths.root).as_posix()
            hashes[name] = manifest.files[name]
    return hashes | {f"flights/{name}": str(digest) for name, digest in digests.items()}


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
    data += suggest_merge(folder, read_manifest(CampaignFolder(folder).manifest))
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
    folder: Path,
    baseline: Path | None = None,
    svg: bool = False,
    stage: Stage = nullcontext,
    out: Path | None = None,
    requirements: Path | None = None,
    junit: Path | None = None,
) -> Path:
    """Write a folder's report into ``out``, by default the folder itself, and return its page.

    ``svg`` also writes each figure as SVG; ``requirements`` judges the flights in place of the folder's; ``junit``
    takes the verdicts as JUnit XML. Raise InputError.
    """
    from abhv_mc.folder.flown_campaign import read_flown
    from abhv_mc.folder.layout import explain_os_error, write_text
    from abhv_mc.report.numbers.compare import compare_baseline
    from abhv_mc.report.numbers.report_numbers import make_numbers
    from abhv_mc.report.pages.matrix import judged_cases, make_junit, make_matrix, make_metrics
    from abhv_mc.report.pages.page import PageFigure, make_page
    from abhv_mc.topics.figure_style import write_png, write_svg
    from abhv_mc.topics.metrics import METRICS
    from abhv_mc.topics.registry import make_figures
    from abhv_mc.topics.topic import Models
    from abhv_mc.topics.verdicts import VERDICTS

    refuse_search(folder, read_manifest(CampaignFolder(folder).manifest))
    key = make_key(folder, baseline)  # as it is now: a run may go on meanwhile
    results = read_flown(folder, requirements)
    models = Models(results, page=out or folder)
    held = compare_baseline(results, baseline) if baseline else None
    with stage("report: statistics"):
        numbers = {**make_numbers(models, held), "files": hash_files(folder)}
    out = out or folder
    written = CampaignFolder(out)
    figures_folder = out / "figures"
    with explain_os_error(figures_folder, writing=True):
        figures_folder.mkdir(parents=True, exist_ok=True)
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
    page = out / "report.html"
    pages = {
        page: make_page(models, figures, failed, held),
        written.metrics: make_metrics(models[METRICS]),
    }
    if results.campaign.requirements:
        pages[written.matrix] = make_matrix(models[VERDICTS], results.campaign.metrics)
    for path, content in pages.items():
        write_text(path, content)
    if junit is not None:
        write_text(junit, make_junit(out.name, judged_cases(models[VERDICTS])))
    pictures = hash_pages(out, [path.relative_to(out).as_posix() for path in sorted(kept)])
    names = [path.name for path in pages]
    numbers |= {"pages": hash_pages(out, names), "pictures": pictures, "key": key}
    write_text(out / "report.json", json.dumps(numbers, indent=1, allow_nan=False) + "\n")
    return page
