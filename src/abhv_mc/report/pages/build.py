"""Creation of a report in the folder of a campaign: numbers, figures and page."""

import hashlib
import json
import shlex
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

from abhv_mc.folder.flights import Digest, parse_block_name, read_digest
from abhv_mc.folder.hashes import data_files
from abhv_mc.folder.layout import CampaignFolder, explain_os_error, hash_file, write_text
from abhv_mc.folder.manifest import Manifest, hash_entries, read_manifest
from abhv_mc.folder.merge import suggest_merge
from abhv_mc.identity import code_hash
from abhv_mc.io.messages import InputError
from abhv_mc.process_settings import rare_garbage_collection
from abhv_mc.report.numbers.summary import HASH, read_numbers

Stage = Callable[[str], AbstractContextManager[object]]


def hash_files(folder: Path) -> dict[str, str]:
    """Return hashes of a report's inputs: SHA-256 of files by path, and digests of flights.

    A digest covers all rows of a controller, because recomputed blocks may divide the rows into
    different files.
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
    """Return the SHA-256 of pages by name; None for a missing page."""
    return {name: hash_file(folder / name) if (folder / name).is_file() else None for name in names}


def hash_failure_map(folder: Path) -> str | None:
    """Return the SHA-256 of the failure map; None if there is none."""
    path = CampaignFolder(folder).failure_map
    return hash_file(path) if path.is_file() else None


def report_key(folder: Path, baseline: Path | None = None) -> str:
    """Return a hash of everything a report depends on: data, manifests, baseline and program."""
    from abhv_mc.topics.topic import user_topics
    from abhv_mc.version import ROOT, __version__

    code = {
        path.relative_to(ROOT).as_posix(): hash_file(path)
        for name in ("report", "statistics", "topics")
        for package in ROOT.glob("abhv_mc*")
        for path in (package / name).rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    data: list[Any] = [__version__, code, hash_file(folder / "manifest.json")]
    data.append([topic.name for topic in user_topics()])
    data += suggest_merge(folder, read_manifest(CampaignFolder(folder).manifest))
    data += filter(None, [hash_failure_map(folder)])
    data += map(hash_file, CampaignFolder(folder).replayed_files())
    if baseline is not None:
        data += [baseline.as_posix(), hash_file(baseline / "manifest.json")]
    text = json.dumps(data, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def is_up_to_date(folder: Path, baseline: Path | None = None) -> bool:
    """Return whether the page and its figures match the data and the program version."""
    try:
        written = read_numbers(folder) or {}
        hashes = {**written["pages"], **written["pictures"]}
        is_current = written["key"] == report_key(folder, baseline) and "report.html" in hashes
        return bool(is_current and hash_pages(folder, hashes) == hashes)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return False


def refuse_search(root: Path, manifest: Manifest) -> None:
    """Raise InputError, which names the command that makes the page, for a search's folder."""
    if manifest.search:
        expected = f"a campaign; for the page of the search, run `{search_command(root, manifest)}`"
        raise InputError(root, "the folder contains the flights of a search", expected)


def search_command(root: Path, manifest: Manifest) -> str:
    """Return the command that remakes the page of a search from its folder."""
    search = manifest.search or {}
    if search["kind"] == "worst":
        options = ["--metric", search["metric"], "--box", f"{search['box']:g}"]
        options += ["--above" if search["bad"] == "high" else "--below"] * bool(search["bad"])
    else:
        options = ["--requirement", search["requirement"]]
        options += ["--target-cov", f"{search['target_cov']:g}"]
    command = ["abhv-mc", search["kind"], str(root / "campaign.yaml"), "--controller"]
    command += [search["controller"], *options, "--flights", str(search["flights"])]
    return shlex.join([*command, "-o", str(root)])


@rare_garbage_collection()
def build_report(
    folder: Path,
    baseline: Path | None = None,
    svg: bool = False,
    stage: Stage = nullcontext,
    out: Path | None = None,
    requirements: Path | None = None,
    junit: Path | None = None,
) -> Path:
    """Write the report of a campaign's folder and return the path of its page.

    Parameters
    ----------
    folder
        Folder of the campaign.
    baseline
        Folder of an earlier campaign on the same samples, with which the campaign is compared.
    svg
        Also write each figure as SVG.
    stage
        Function that shows progress: given the name of a stage, it returns a context manager.
    out
        Folder of the report; by default, the folder of the campaign.
    requirements
        File with requirements that replace those of the folder.
    junit
        File for the verdicts as JUnit XML.

    Raises
    ------
    InputError
        If the folder does not contain a campaign, or if a file is invalid.
    """
    from abhv_mc.folder.flown_campaign import read_flown
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
    # The key is computed first, because a run may add flights in the meantime.
    key = report_key(folder, baseline)
    results = read_flown(folder, requirements)
    models = Models(results, page=out or folder)
    comparison = compare_baseline(results, baseline) if baseline else None
    with stage("report: statistics"):
        numbers = {**make_numbers(models, comparison), "files": hash_files(folder)}
    out = out or folder
    written = CampaignFolder(out)
    figures_folder = out / "figures"
    with explain_os_error(figures_folder, writing=True):
        figures_folder.mkdir(parents=True, exist_ok=True)
    figures, failed = [], []
    with stage("report: figures"):
        for topic, topic_figures in make_figures(models).items():
            try:
                for text, figure in topic_figures:
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
                    f"figures of {topic} could not be made ({type(error).__name__}: {error})"
                )
    results.refuse_changes()
    current_files = {
        figure.path.with_suffix(kind) for figure in figures for kind in (".png", *[".svg"] * svg)
    }
    for stale in {*figures_folder.glob("*.png"), *figures_folder.glob("*.svg")} - current_files:
        stale.unlink(missing_ok=True)  # Another process may delete this file at the same time.
    page = out / "report.html"
    pages = {
        page: make_page(models, figures, failed, comparison),
        written.metrics: make_metrics(models[METRICS]),
    }
    if results.campaign.requirements:
        pages[written.matrix] = make_matrix(models[VERDICTS], results.campaign.metrics)
    for path, content in pages.items():
        write_text(path, content)
    if junit is not None:
        write_text(junit, make_junit(out.name, judged_cases(models[VERDICTS])))
    pictures = hash_pages(out, [path.relative_to(out).as_posix() for path in sorted(current_files)])
    names = [path.name for path in pages]
    numbers |= {"pages": hash_pages(out, names), "pictures": pictures, "key": key}
    numbers["failure_map"] = hash_failure_map(folder)
    numbers["code"] = code_hash()
    numbers[HASH] = hash_entries(numbers)
    # Each entry is on one line: indentation would make the encoder several times slower.
    lines = [
        f"{json.dumps(name)}: {json.dumps(entry, allow_nan=False)}"
        for name, entry in numbers.items()
    ]
    write_text(out / "report.json", "{\n" + ",\n".join(lines) + "\n}\n")
    return page
