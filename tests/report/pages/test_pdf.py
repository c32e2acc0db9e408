"""Pages printed by a browser, for which a script stands in."""

import pytest

from abhv_mc.io.messages import InputError
from abhv_mc.report.pages.pdf import find_browser, print_pdf

PRINTS = """#!/bin/sh
for last; do case $last in --print-to-pdf=*) target=${last#*=};; esac; done
cp "${last#file://}" "$target"
"""


@pytest.mark.parametrize(
    ("letter", "brief", "name", "size"),
    [(False, False, "report.pdf", "A4"), (True, True, "brief.pdf", "letter")],
)
def test_a_page_is_printed_in_its_size(tmp_path, letter, brief, name, size):
    page, browser = tmp_path / "report.html", tmp_path / "browser"
    page.write_text("<head></head>", "utf-8")
    browser.write_text(PRINTS, "utf-8")
    browser.chmod(0o755)
    target = print_pdf(page, str(browser), letter, brief)
    printed = target.read_text("utf-8")
    assert target == tmp_path / name and f"size: {size};" in printed
    assert ("display: none" in printed) == brief and page.read_text("utf-8") == "<head></head>"
    browser.write_text("#!/bin/sh\necho no fonts >&2\n", "utf-8")
    with pytest.raises(InputError, match="no fonts"):
        print_pdf(page, str(browser), letter, brief)
    assert not target.exists()


@pytest.mark.parametrize("installed", [("chromium",), ("msedge", "google-chrome"), ()])
def test_the_first_installed_browser_of_the_list_is_used(monkeypatch, installed):
    monkeypatch.setattr("shutil.which", lambda name: f"/bin/{name}" if name in installed else None)
    if installed:
        assert find_browser() == f"/bin/{installed[-1]}"
    else:
        with pytest.raises(InputError, match="no Chromium"):
            find_browser()
