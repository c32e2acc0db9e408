"""Fly the default campaign and keep its report as the example in reports/example: `make example`.

The HTML page is left out (6 MB); where Chromium is installed, its first screen becomes docs/images/report.png.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
CAMPAIGN = ROOT / "campaigns/s_manoeuvre.yaml"
EXAMPLE = ROOT / "reports/example"
KEPT = ("report.md", "report.json")


def abhv_mc(*words: str | Path) -> None:
    """Run a command of the program, and stop where it fails."""
    subprocess.run([sys.executable, "-m", "abhv_mc", *map(str, words)], check=True)  # noqa: S603


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


def main() -> None:
    """Fly, report, copy."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / "s_manoeuvre"
        abhv_mc("run", CAMPAIGN, "-o", folder)
        abhv_mc("report", folder, "--format", "md")
        shutil.rmtree(EXAMPLE, ignore_errors=True)
        shutil.copytree(folder / "figures", EXAMPLE / "figures")
        for name in KEPT:
            shutil.copyfile(folder / name, EXAMPLE / name)
        take_picture(folder / "report.html")


if __name__ == "__main__":
    main()
