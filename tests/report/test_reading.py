"""Report in a browser: first screen, links to flights, print and accessibility."""

import base64
import json
import re
import shlex
import shutil
import subprocess

import pytest
from programs import run_python
from report.synthetic import write_campaign

from abhv_mc.report.pages.build import build_report

PAPER = {"A4": (8.27, 11.69), "Letter": (8.5, 11.0)}
MOST_PAGES = {"A4": 10, "Letter": 11}  # Letter is 18 mm shorter.
METRICS = (
    "altitude_error_max_m", "speed_error_max_mps", "sideslip_max_deg", "bank_error_settled_max_deg",
    "angle_of_attack_error_settled_max_deg", "altitude_error_rms_m", "speed_error_rms_mps",
    "sideslip_rms_deg",
    "heading_error_max_deg", "cross_track_error_max_m", "aileron_rms_deg", "rudder_rms_deg",
)  # fmt: skip


@pytest.fixture(scope="module")
def report_folder(tmp_path_factory):
    """Run the default campaign with its report."""
    folder = tmp_path_factory.mktemp("default") / "s_manoeuvre"
    run_python("-m", "abhv_mc", "run", "s_manoeuvre", "-o", folder, check=True)
    return folder


@pytest.fixture(scope="module")
def crowded(tmp_path_factory):
    """Write a report of eight controllers and twelve requirements, some missed by most flights."""
    requirements = [
        f"{{metric: {name}, below: 1.5, probability: 0.9, consumer_risk: 0.1}}" for name in METRICS
    ]
    names = ["tlc", *(f"lqr_{k}" for k in range(7))]
    folder = tmp_path_factory.mktemp("crowded") / "c"
    build_report(
        write_campaign(folder, runs=40, failing=4, controllers=names, requirements=requirements)
    )
    return folder


@pytest.fixture(scope="module")
def sparse(tmp_path_factory):
    """Write a report of one controller without requirements."""
    folder = tmp_path_factory.mktemp("sparse") / "c"
    build_report(write_campaign(folder, runs=40, controllers=["tlc"], requirements=[]))
    return folder


@pytest.fixture(params=["report_folder", "crowded", "sparse"])
def folder(request):
    return request.getfixturevalue(request.param)


# Positions and number of words of the assessment, and texts that are cut off.
FIRST = """(() => {
  const bottom = (s) => { const e = document.querySelector(s); return e ? \
e.getBoundingClientRect().bottom : 0; };
  const words = [...document.querySelectorAll("#answer :is(.records, figcaption, p)")]
    .map((e) => e.innerText).join(" ");
  const count = words.trim().split(/\\s+/).length;
  return { ends: ["h1", ".records", ".lead figure", ".chart", ".axis"].map(bottom), words: count,
    cut: [...document.querySelectorAll("#answer .name, #answer dd, #answer th")]
      .filter((e) => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== "inline")
      .map((e) => e.textContent) };
})()"""


@pytest.mark.parametrize("dark", [False, True])
def test_the_answer_is_on_the_first_screen(page, folder, dark):
    page.show(folder / "report.html", dark=dark)
    screen = page.ask(FIRST)
    assert max(screen["ends"]) < 900 and screen["words"] <= 150 and screen["cut"] == []


WIDE = """[...document.querySelectorAll("table")].filter((t) => t.clientWidth && \
t.getBoundingClientRect().width
  > t.parentElement.getBoundingClientRect().width + 1).map((t) => t.caption?.innerText ?? \
t.className)"""


def test_no_table_is_wider_than_its_box_and_no_window_needs_sideways_scrolling(page, folder):
    for width in (320, 768, 1400):
        page.show(folder / "report.html", width, 700)
        assert page.ask("document.documentElement.scrollWidth") <= width
    page.ask("for (const part of document.querySelectorAll('details')) part.open = true")
    assert page.ask(WIDE) == []


@pytest.mark.parametrize("name", ["report_folder", "sparse"])
def test_axe_finds_nothing(page, name, request):
    axe = pytest.importorskip("axe_core_python.base")
    page.call("Page.setBypassCSP", enabled=True)
    page.show(request.getfixturevalue(name) / "report.html")
    page.ask("for (const part of document.querySelectorAll('details')) part.open = true")
    page.ask("document.querySelector('#flight-rows button').click()")
    page.ask(axe.AXE_FILE_PATH.read_text("utf-8"))
    violations = json.loads(
        page.ask("axe.run().then((found) => JSON.stringify(found.violations))", wait=True)
    )
    assert [
        (rule["id"], node["target"], node["failureSummary"])
        for rule in violations
        for node in rule["nodes"]
    ] == []


LISTED = (
    "[...document.querySelectorAll('#flights details [data-show]')].map((link) => "
    "link.dataset.show)"
)
SHOWN = """({ title: document.getElementById("flight-title").textContent,
  drawn: !document.getElementById("flight-plots").hidden
    && document.querySelectorAll("#flight-history .scatterlayer .trace").length,
  command: document.getElementById("flight-command").textContent })"""


def test_a_click_on_a_worst_flight_draws_it(page, report_folder, report_json):
    page.show(report_folder / "report.html")
    listed = page.ask(LISTED)
    worst = {
        name: [entry["flight"] for entry in flights]
        for name, flights in report_json["flights"]["worst"].items()
    }
    assert listed == [f"{name} {flight}" for name, flights in worst.items() for flight in flights]
    for k, entry in enumerate(listed):
        page.ask(f"document.querySelectorAll('#flights details [data-show]')[{k}].click()")
        name, flight = entry.split()
        panel = page.ask(SHOWN)
        assert panel["title"].startswith(
            f"{report_json['provenance']['labels'][name]}, flight {flight}:"
        )
        assert panel["drawn"]
        assert shlex.split(panel["command"])[2:] == [
            ".",
            "--flight",
            flight,
            "--controller",
            name,
        ]


SCATTER = """(() => { const scatter = document.getElementById("scatter"); \
scatter.scrollIntoView({ block: "center" });
  const box = scatter.getBoundingClientRect(); return [box.left, box.top, box.width, box.height]; \
})()"""


def test_a_click_on_a_point_draws_its_flight(page, report_folder):
    page.show(report_folder / "report.html")
    named = set()
    for k in range(24 * 12):
        left, top, width, height = page.ask(SCATTER)
        x, y = left + width * (k % 24 + 0.5) / 24, top + height * (k // 24 + 0.5) / 12
        page.move(x, y)
        name = (
            page.ask("document.getElementById('scatter-at').textContent").strip().rpartition(":")[0]
        )
        if name:
            page.click(x, y)
            assert page.ask(SHOWN)["title"].startswith(f"{name}: ")
            named.add(name)
    assert len(named) > 6


@pytest.mark.parametrize("size", PAPER)
def test_paper_is_evidence(page, report_folder, report_json, size, tmp_path):
    page.show(report_folder / "report.html")
    target = tmp_path / "report.pdf"
    width, height = PAPER[size]
    printed = page.call(
        "Page.printToPDF", paperWidth=width, paperHeight=height, preferCSSPageSize=False
    )
    target.write_bytes(base64.b64decode(printed["data"]))
    assert 0 < len(re.findall(rb"/Type\s*/Page\b", target.read_bytes())) <= MOST_PAGES[size]
    if shutil.which("pdftotext") is None:
        pytest.skip("no pdftotext is installed")
    text = subprocess.run(
        ["pdftotext", "-layout", target, "-"], capture_output=True, text=True, check=True
    ).stdout
    flat = "".join(text.split())
    for fragment in (report_json["digest"], "seed2014", "abhvmc0.1.0", "abhv-mcrun"):
        assert fragment in flat, fragment
    assert "Click a" not in text
    assert "Prepared Checked Approved Date" in " ".join(text.split())
