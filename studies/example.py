"""Run the default campaign and store its report as the example in reports/example: `make example`.

The stored files are the same on every machine. Folders and times of the run, and hashes that depend
on the linear algebra of a machine, are omitted, and numbers have nine digits. The HTML page (6 MB)
is also omitted; if Chromium is installed, its first screen is stored as docs/images/report.png.

`python studies/example.py FOLDER` writes into another folder, without the picture.
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
SHOWN = ("summary", "verdicts", "comparison", "margins", "drivers", "failures")
HASHES = {"code", "digest", "digests", "failure_map", "files", "hash", "key", "pages", "pictures"}


def in_words(numbers: dict[str, Any], outputs: dict[str, str]) -> str:
    """Return the page with the first screen and the output of ``show`` for each topic."""
    sections = [
        f"# {numbers['provenance']['question']}",
        "![First screen of the report](../../docs/images/report.png)",
        "The head of `campaigns/s_manoeuvre.yaml` states how the controllers were tuned.",
    ]
    for topic, printed in outputs.items():
        stripped = (line.rstrip() for line in printed.strip("\n").splitlines())
        lines = "\n".join(
            line if line.startswith(" ") else textwrap.fill(line, 120) for line in stripped
        )
        sections.append(f"`abhv-mc show {topic} reports/s_manoeuvre`:\n\n```text\n{lines}\n```")
    return "\n\n".join(sections) + "\n"


def keep_numbers(numbers: dict[str, Any]) -> dict[str, Any]:
    """Return the report's numbers without hashes, with nine digits."""

    def rounded(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: rounded(item) for key, item in value.items() if key not in HASHES}
        if isinstance(value, list):
            return [rounded(item) for item in value]
        return float(f"{value:.9g}") if isinstance(value, float) else value

    result: dict[str, Any] = rounded(numbers)
    return result


def take_picture(page: Path, profile: Path) -> None:
    """Write the page's first screen as a PNG if a browser is installed."""
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
    """Run the campaign and store its report."""
    with tempfile.TemporaryDirectory() as temporary:

        def abhv_mc(*arguments: str) -> str:
            process = subprocess.run(  # noqa: S603
                [sys.executable, "-m", "abhv_mc", *arguments],
                check=True,
                cwd=temporary,
                stdout=subprocess.PIPE,
                text=True,
            )
            return process.stdout

        results = Path("reports/s_manoeuvre")  # relative, as in the commands of the report
        abhv_mc("run", "s_manoeuvre", "-o", results.as_posix(), *options)
        folder = Path(temporary) / results
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(folder / "figures", target / "figures")
        numbers = keep_numbers(json.loads((folder / "report.json").read_text(encoding="utf-8")))
        (target / "report.json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
        outputs = {topic: abhv_mc("show", topic, results.as_posix()) for topic in SHOWN}
        (target / "README.md").write_text(in_words(numbers, outputs), encoding="utf-8")
        if target == EXAMPLE:
            take_picture(folder / "report.html", Path(temporary) / "profile")


if __name__ == "__main__":
    if sys.argv[1:] == ["--smoke"]:
        with tempfile.TemporaryDirectory() as trial:
            main(Path(trial), "--runs", "2")
    else:
        main(Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else EXAMPLE)
