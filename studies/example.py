"""Fly the default campaign and keep its report as the example in reports/example: `make example`.

What is kept is the same on every machine: what only tells where and when it was flown, and hashes of bits that another
machine's linear algebra may change, are left out, and numbers are kept to nine digits. The HTML page is left out, too
(6 MB); where Chromium is installed, its first screen becomes docs/images/report.png.

`python studies/example.py FOLDER` writes into another folder, and takes no picture.
"""

import json
import shutil
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "reports/example"
SHOWN = ("verdicts", "comparison", "drivers", "failures")
HASHES = {"digest", "digests", "files", "key", "pages", "pictures"}


def in_words(numbers: dict[str, Any], shown: dict[str, str]) -> str:
    """The first screen, and what ``show`` prints of each topic."""
    parts = [
        f"# {numbers['provenance']['question']}",
        "![The first screen](../../docs/images/report.png)",
    ]
    for topic, printed in shown.items():
        told = (line.rstrip() for line in printed.strip("\n").splitlines())
        lines = "\n".join(
            line if line.startswith(" ") else textwrap.fill(line, 120) for line in told
        )
        parts.append(f"`abhv-mc show {topic} reports/s_manoeuvre`:\n\n```text\n{lines}\n```")
    return "\n\n".join(parts) + "\n"


def keep_numbers(numbers: dict[str, Any]) -> dict[str, Any]:
    """The report's numbers without hashes, to nine digits."""

    def rounded(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: rounded(item) for key, item in value.items() if key not in HASHES}
        if isinstance(value, list):
            return [rounded(item) for item in value]
        return float(f"{value:.9g}") if isinstance(value, float) else value

    kept: dict[str, Any] = rounded(numbers)
    return kept


def take_picture(page: Path, profile: Path) -> None:
    """The page's first screen as a PNG, where a browser is there."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        print("no Chromium: docs/images/report.png stays as it is", file=sys.stderr)
        return
    picture = ROOT / "docs/images/report.png"
    options = [
        "--headless",
        "--no-sandbox",
        "--hide-scrollbars",
        "--window-size=1200,900",
        "--virtual-time-budget=9000",
        "--disable-gpu",
        "--no-first-run",
        "--disable-background-networking",
        f"--user-data-dir={profile}",
    ]
    subprocess.run([browser, *options, f"--screenshot={picture}", page.as_uri()], check=True)  # noqa: S603


def main(target: Path, *options: str) -> None:
    """Fly, report, keep."""
    with tempfile.TemporaryDirectory() as temporary:

        def abhv_mc(*words: str) -> str:
            told = subprocess.run([sys.executable, "-m", "abhv_mc", *words], check=True, cwd=temporary,  # noqa: S603
                                  stdout=subprocess.PIPE, text=True)  # fmt: skip
            return told.stdout

        flown = Path(
            "reports/s_manoeuvre"
        )  # relative, so that the commands in the report name no machine's folder
        abhv_mc("run", "s_manoeuvre", "-o", flown.as_posix(), *options)
        folder = Path(temporary) / flown
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(folder / "figures", target / "figures")
        numbers = keep_numbers(json.loads((folder / "report.json").read_text(encoding="utf-8")))
        (target / "report.json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
        shown = {topic: abhv_mc("show", topic, flown.as_posix()) for topic in SHOWN}
        (target / "README.md").write_text(in_words(numbers, shown), encoding="utf-8")
        if target == EXAMPLE:
            take_picture(folder / "report.html", Path(temporary) / "profile")


if __name__ == "__main__":
    if sys.argv[1:] == ["--smoke"]:
        with tempfile.TemporaryDirectory() as trial:
            main(Path(trial), "--runs", "2")
    else:
        main(Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else EXAMPLE)
