"""Tests that numbers on pages are up to date: reports/example and the table of margins."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

import abhv_mc
from abhv_mc.execution.runner import run_campaign
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.report.numbers.report_numbers import make_numbers
from abhv_mc.requests import Request
from abhv_mc.topics.topic import Models

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))
from example import HASHES, keep_numbers

AGREEMENT = 1e-6  # relative: gains from another machine's linear algebra differ in their last bits


def leaves(value, path=""):
    """Yield all values in a JSON value, with their paths."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(inner, f"{path}/{key}")
        yield path, len(value)
    else:
        yield path, value


@pytest.fixture(scope="module")
def example(repository):
    return repository / "reports" / "example"


@pytest.fixture(scope="module")
def flown(repository, tmp_path_factory):
    folder = tmp_path_factory.mktemp("example") / "flown"
    return run_campaign(Request(repository / "campaigns" / "s_manoeuvre.yaml", folder)).folder


def test_the_example_has_the_numbers_of_the_default_campaign(flown, example):
    today = keep_numbers(json.loads(json.dumps(make_numbers(Models(read_flown(flown))))))
    stored = json.loads((example / "report.json").read_text(encoding="utf-8"))
    today, stored = dict(leaves(today)), dict(leaves(stored))
    numbers = [
        key
        for key, value in stored.items()
        if isinstance(value, float) and isinstance(today.get(key), float)
    ]
    assert {key: today.pop(key) for key in numbers} == pytest.approx(
        {key: stored.pop(key) for key in numbers}, rel=AGREEMENT, abs=1e-12
    ), "make example"
    assert today == stored, "make example"


def test_the_example_does_not_depend_on_the_machine(example):
    text = (example / "README.md").read_text(encoding="utf-8")
    assert not re.search(r"\d{4}-\d\d-\d\dT|/(?:tmp|home|Users|root)/|[A-Za-z]:\\", text)
    stored = json.loads((example / "report.json").read_text(encoding="utf-8"))
    assert not HASHES & {*stored, *stored["provenance"]}


def _shown(number, digits):
    return f"{number:.{digits}f}" if np.isfinite(number) else "none"


def _cell(row):
    gains = f"{_shown(row.gain_margin_low_db, 1)}/{_shown(row.gain_margin_high_db, 1)}"
    return f"{gains}, {_shown(row.phase_margin_deg, 0)}, {_shown(row.delay_margin_ms, 0)}"


@pytest.mark.parametrize(
    ("vehicle", "controller", "mission"),
    [
        ("abhv", "lqr", "level"),
        ("ghame_x", "inversion", "level"),
        ("winged_cone", "tlc", "level_mach15"),
    ],
)
def test_the_table_of_margins_is_up_to_date(repository, vehicle, controller, mission):
    page = (repository / "docs" / "explanation" / "margins.md").read_text("utf-8")
    margins = abhv_mc.margins(mission, vehicle, controller)
    cells = " | ".join(_cell(margins.loc[loop]) for loop in margins.index[:4])
    together = f"{margins.disk_margin['all']:.3f}, {margins.delay_margin_ms['all']:.1f}"
    assert f"| {vehicle} | {controller} | {cells} | {together} |" in page
