import re
from itertools import combinations

import numpy as np
import pytest
from PIL import Image

from abhv_mc.report.pages.build import build_report
from abhv_mc.topics import registry
from abhv_mc.topics.registry import make_figures
from abhv_mc.topics.topic import Models
from abhv_mc_tune.page import plot_front

FILES = [
    "channels",
    "critical_errors",
    "distribution_asked",
    "drivers",
    "error_against_usage",
    "worst_flights",
]


def test_the_report_holds_every_figure_at_print_resolution(report_folder):
    assert sorted(path.stem for path in (report_folder / "figures").glob("*.png")) == FILES
    for path in (report_folder / "figures").glob("*.png"):
        with Image.open(path) as image:
            # 7.2 in at 200 dpi; 5 in for the figure beside the summary
            assert image.width == (1000 if path.stem == "critical_errors" else 1440)
            assert image.convert("RGBA").getpixel((0, 0))[3] == 0  # the page's ground
            assert image.info["dpi"] == pytest.approx((200, 200), abs=0.1)
        assert (
            path.stat().st_size < 400_000
        )  # in full colour: a palette took half of the report's time


@pytest.fixture(scope="module")
def figures(failing):
    """Return every figure of a report by its name."""
    topic_figures = make_figures(Models(failing)).values()
    return {text.name: figure for pairs in topic_figures for text, figure in pairs}


def test_a_figure_that_fails_is_named_on_the_page(failing_folder, monkeypatch):
    monkeypatch.setattr(registry, "make_figures", lambda *_: {"margins": (1 // 0 for _ in "a")})
    page = build_report(failing_folder).read_text("utf-8")
    assert re.search(r"\bmargins\b[^(]*\(ZeroDivisionError", page)


@pytest.mark.thorough
def test_nothing_is_cut_off_and_no_panel_reaches_into_another(figures):
    """Margins are fixed, so that texts of another size would overlap or be cut off."""
    for name, figure in figures.items():
        figure.canvas.draw()
        box = figure.get_tightbbox()
        assert min(box.x0, box.y0) >= -0.01, name
        assert box.x1 <= figure.get_figwidth() + 0.01 and box.y1 <= figure.get_figheight() + 0.01, (
            name
        )
        boxes = [axes.get_tightbbox() for axes in figure.axes if axes.get_visible()]
        boxes += [legend.get_window_extent() for legend in figure.legends]
        for box_a, box_b in combinations(boxes, 2):
            width, height = (min(getattr(box_a, e), getattr(box_b, e)) for e in ("x1", "y1"))
            overlaps = width - max(box_a.x0, box_b.x0), height - max(box_a.y0, box_b.y0)
            assert min(overlaps) <= 6.0, name  # px of 1440


def test_the_front_shows_the_result_though_its_error_is_larger_than_the_starts():
    """Regression: a result within a limit that the start violates lay outside the figure."""
    usage, error = np.array([1.0, 1.4, 9.0]), np.array([2.0, 7.0, 2.5])
    points = usage, error, np.array([False, True, False])
    figure = plot_front(("usage", "error"), points, np.array([1]), 1)
    axes = figure.axes[0]
    assert axes.get_ylim()[1] > 7.0 and axes.get_xlim()[1] > 1.4
