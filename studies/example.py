"""Fly the default campaign and keep its report as the example in reports/example: `make example`.

What is kept is the same on every machine: what only tells where and when it was flown, and hashes of bits that another
machine's linear algebra may change, are left out, and numbers are kept to nine digits. The HTML page is left out, too
(6 MB); where Chromium is installed, its first screen becomes docs/images/report.png.

`python studies/example.py FOLDER` writes into another folder, and takes no picture.
"""

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "reports/example"
HASHES = {"digest", "digests", "files", "key", "pages", "pictures"}
_ROW_OF_ONE_MACHINE = re.compile(
    r"^\| (started|wall time s|command|commit|compiler|flown by|(source|manifest) hash"
    r"|(machine|versions|digests?)\b.*?) \|"
)


def keep_text(report: str) -> str:
    """The report in Markdown without the rows that belong to one machine and one day."""
    return "".join(line for line in report.splitlines(keepends=True) if not _ROW_OF_ONE_MACHINE.match(line))


def keep_numbers(numbers: dict[str, Any]) -> dict[str, Any]:
    """The report's numbers without hashes, to nine digits."""

    def rounded(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: rounded(item) for key, item in value.items()}
        if isinstance(value, list):
            return [rounded(item) for item in value]
        return float(f"{value:.9g}") if isinstance(value, float) else value

    return {key: rounded(value) for key, value in numbers.items() if key not in HASHES}


def take_picture(page: Path) -> None:
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
    ]
    subprocess.run([browser, *options, f"--screenshot={picture}", page.as_uri()], check=True)  # noqa: S603


def main(target: Path) -> None:
    """Fly, report, keep."""
    with tempfile.TemporaryDirectory() as temporary:

        def abhv_mc(*words: str) -> None:
            subprocess.run([sys.executable, "-m", "abhv_mc", *words], check=True, cwd=temporary)  # noqa: S603

        flown = Path("reports/s_manoeuvre")  # relative, so that the commands in the report name no machine's folder
        abhv_mc("run", "s_manoeuvre", "-o", flown.as_posix())
        abhv_mc("report", flown.as_posix(), "--format", "md")
        folder = Path(temporary) / flown
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(folder / "figures", target / "figures")
        report = (folder / "report.md").read_text(encoding="utf-8")
        (target / "report.md").write_text(keep_text(report), encoding="utf-8")
        numbers = keep_numbers(json.loads((folder / "report.json").read_text(encoding="utf-8")))
        (target / "report.json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
        if target == EXAMPLE:
            take_picture(folder / "report.html")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else EXAMPLE)
