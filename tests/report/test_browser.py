"""The page in a real browser: no console message, nothing leaves, switches work, narrow windows fit."""

import base64
import hashlib
import json
import re
import shutil
import subprocess

import pytest

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")

# Runs in the page after its own script; what it finds goes into an attribute that the test reads.
PROBE = """
<script>
const loaded = new Promise((done) => { addEventListener("load", done); });
const drawn = new Promise((done) => { addEventListener("drawn", done); });
Promise.all([loaded, drawn]).then(() => {
  const plot = document.getElementById("plot");
  const names = () => plot.data.map((trace) => trace.name);
  const found = { before: names(), errors: [] };
  const box = (name) => document.querySelector(`input[name="${name}"]`);
  box("lqr").click();
  found.withoutLqr = names();
  for (const name of ["all", "wide", "narrow"]) box(name).click();
  found.withoutBands = names();
  const channel = document.getElementById("channel");
  channel.value = "sideslip_deg";
  channel.dispatchEvent(new Event("change"));
  found.axis = plot.layout.yaxis.title.text;
  found.words = document.getElementById("plot-words").textContent;
  found.drawn = plot.querySelectorAll(".scatterlayer .trace").length;
  found.images = [...document.images].every((image) => image.complete && image.naturalWidth > 0);
  found.width = document.documentElement.clientWidth;
  found.overflow = document.documentElement.scrollWidth;
  found.wide = [...document.body.querySelectorAll("*")]
    .filter((element) => !element.closest(".scroll > *, .skip") && element.getBoundingClientRect().right > found.width)
    .map((element) => `${element.tagName} ${element.id} ${element.className} ${element.textContent.slice(0, 60)}`);
  found.tools = [...plot.querySelectorAll(".modebar-btn")].map((button) => button.dataset.title);
  found.asked = performance.getEntriesByType("resource").map((entry) => entry.name)
    .filter((name) => !name.startsWith("data:"));
  document.body.dataset.found = JSON.stringify(found);
  parent.postMessage(JSON.stringify(found), "*");
});
</script>
"""
FRAME = """<!doctype html><title>frame</title>
<iframe src="{page}" style="width:{width}px;height:700px;border:0"></iframe>
<script>addEventListener("message", (event) => {{ document.body.dataset.found = event.data; }});</script>
"""


def browse(tmp_path, url, *options):
    """Load a page; returns its document after the scripts ran, and what the browser logged."""
    command = [
        BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        "--disable-component-update", "--disable-sync", "--no-first-run", "--disable-dev-shm-usage",
        f"--user-data-dir={tmp_path / 'profile'}", "--enable-logging=stderr", "--virtual-time-budget=10000",
        *options, "--dump-dom", url,
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return done.stdout, done.stderr


def found_in(document):
    text = re.search(r'<body[^>]* data-found="([^"]*)"', document).group(1)
    return json.loads(text.replace("&quot;", '"').replace("&amp;", "&"))


def allowed(page):
    """The page with the probe among the scripts that its policy names."""
    script = PROBE.strip().removeprefix("<script>").removesuffix("</script>")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return page.replace("script-src ", f"script-src 'sha256-{digest}' ", 1)


@pytest.fixture(scope="module")
def probed(report_page, tmp_path_factory):
    path = tmp_path_factory.mktemp("browser") / "probed.html"
    path.write_text(allowed(report_page).replace("</body>", PROBE + "</body>"), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def visit(probed):
    return browse(probed.parent, probed.as_uri(), "--window-size=1280,900")


def test_the_console_is_silent(visit):
    _, log = visit
    assert [line for line in log.splitlines() if "CONSOLE" in line] == []


def test_no_request_leaves(visit):
    # A blocked request would also stand on the console, which is silent.
    assert found_in(visit[0])["asked"] == []


def test_no_button_uploads_the_data(visit):
    tools = found_in(visit[0])["tools"]
    assert "Zoom in" in tools and "Reset axes" in tools
    assert not any("hare" in title or "loud" in title or "dit" in title for title in tools)


def test_switches_work(visit):
    found = found_in(visit[0])
    assert "TLC median" in found["before"]
    assert "LQR 5 %" in found["before"]
    assert "reference" in found["before"]
    assert not any(name.startswith("LQR ") and "retuned" not in name for name in found["withoutLqr"])
    assert "LQR retuned median" in found["withoutLqr"]
    assert not any("%" in name or "largest" in name for name in found["withoutBands"])
    assert found["axis"] == "Sideslip (deg)"
    assert "Sideslip" in found["words"]
    assert found["drawn"] == 2  # the medians of the two that are left
    assert found["images"]


@pytest.mark.parametrize("width", [320, 768])
def test_a_narrow_window_needs_no_sideways_scrolling(probed, tmp_path, width):
    frame = probed.parent / f"frame{width}.html"
    frame.write_text(FRAME.format(page=probed.as_uri(), width=width), encoding="utf-8")
    document, _ = browse(tmp_path, frame.as_uri(), "--window-size=1000,800", "--allow-file-access-from-files")
    found = found_in(document)
    assert found["width"] <= width
    assert found["overflow"] <= found["width"], found["wide"]


def test_no_other_script_runs(report_page, tmp_path):
    foreign = (
        "<script>document.body.dataset.foreign = 1</script><img src=x onerror='document.body.dataset.foreign = 1'>"
    )
    path = tmp_path / "foreign.html"
    path.write_text(report_page.replace("</body>", foreign + "</body>"), encoding="utf-8")
    document, log = browse(tmp_path, path.as_uri())
    assert "data-foreign" not in document
    assert "Content Security Policy" in log
