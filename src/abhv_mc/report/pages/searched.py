"""A folder that a search wrote: there is no campaign's report of it."""

import shlex
from pathlib import Path

from abhv_mc.folder.manifest import Manifest
from abhv_mc.io.documents import InputError

SIDES: dict[str | None, tuple[str, ...]] = {"high": ("--above",), "low": ("--below",), None: ()}


def refuse_search(root: Path, manifest: Manifest) -> None:
    """Raise InputError for a search's folder, naming the command that makes its page again."""
    if manifest.search:
        expected = f"the search's own command, which makes its page again from them: {search_command(root, manifest)}"
        raise InputError(root, "the flights of a search, of which there is no campaign's report", expected)


def search_command(root: Path, manifest: Manifest) -> str:
    """The command that answers the search again from what the folder holds."""
    held = manifest.search or {}
    words = ["abhv-mc", held["kind"], str(root / "campaign.yaml"), "--controller", held["controller"]]
    if held["kind"] == "worst":
        words += ["--metric", held["metric"], *SIDES[held["bad"]], "--box", f"{held['box']:g}"]
    else:
        words += ["--requirement", held["requirement"], "--target-cov", f"{held['target_cov']:g}"]
    return shlex.join([*words, "--flights", str(held["flights"]), "-o", str(root)])
