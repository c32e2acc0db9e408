"""Printing of pages to PDF by an installed Chromium."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from abhv_mc.io.messages import InputError, quoted

NAMES = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "msedge",
)
_LONGEST = 120.0  # time-out of the browser, s


def find_browser() -> str:
    """Return the path of an installed Chromium. Raise InputError if there is none."""
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        raise InputError(
            "--pdf",
            "no Chromium-based browser was found",
            f"{quoted(NAMES, 'or')} on PATH (any other browser can print report.html)",
        )
    return program


# The first page shows the summary, the second compares the controllers.
_BRIEF = """
main > section:not(#answer, #comparison), nav, details, footer, .sign, figcaption .file,
#comparison figure, #answer > .scroll { display: none !important; }
#comparison { break-before: page; }
"""


def print_pdf(page: Path, browser: str, letter: bool, brief: bool) -> Path:
    """Print a page to a PDF (A4 or letter) in the same folder, and return the PDF's path.

    If ``brief``, the PDF has only two pages. Raise InputError if the browser fails.
    """
    target = page.with_name("brief.pdf") if brief else page.with_suffix(".pdf")
    target.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory() as profile:
        sized = Path(profile) / page.name
        rules = _BRIEF * brief
        size = f"<style>@page {{ size: {'letter' if letter else 'A4'}; }}{rules}</style></head>"
        sized.write_text(
            page.read_text(encoding="utf-8").replace("</head>", size, 1), encoding="utf-8"
        )
        command = [
            browser, "--headless", "--disable-gpu", "--no-sandbox", f"--user-data-dir={profile}",
            "--no-pdf-header-footer", f"--print-to-pdf={target.absolute()}", sized.as_uri(),
        ]  # fmt: skip
        try:
            process = subprocess.run(  # noqa: S603
                command, capture_output=True, text=True, timeout=_LONGEST, check=False
            )
        except subprocess.TimeoutExpired:
            raise InputError(
                browser,
                f"no PDF was printed within {_LONGEST:g} s",
                "a Chromium-based browser that can print",
            ) from None
    if not target.is_file():
        raise InputError(
            browser,
            f"no PDF was printed ({process.stderr[-200:].strip()})",
            "a Chromium that can print",
        )
    return target
