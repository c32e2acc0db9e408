"""The example in reports/example is what the default campaign gives today."""

import json
import math
from collections.abc import Iterator
from typing import Any

import pytest

from abhv_mc.campaign.run.runner import run_campaign
from abhv_mc.campaign.run.setup import Request
from abhv_mc.report.numbers import make_numbers
from abhv_mc.report.results import read_results

AGREEMENT = 1e-6  # relative: gains from another machine's linear algebra differ in their last bits
BYTES = {"digest", "digests", "files", "key", "pages", "pictures"}  # hashes of bits, which such gains change


def differences(found: Any, kept: Any, place: str = "") -> Iterator[str]:
    """Where two values of JSON differ."""
    if isinstance(found, dict) and isinstance(kept, dict):
        for key in sorted({*found, *kept}):
            if key in found and key in kept:
                yield from differences(found[key], kept[key], f"{place}/{key}")
            else:
                yield f"{place}/{key} is in one of both only"
    elif isinstance(found, list) and isinstance(kept, list) and len(found) == len(kept):
        for i, pair in enumerate(zip(found, kept, strict=True)):
            yield from differences(*pair, f"{place}/{i}")
    elif isinstance(found, float) and isinstance(kept, (int, float)):
        if not math.isclose(found, kept, rel_tol=AGREEMENT, abs_tol=1e-12):
            yield f"{place}: {found} today, {kept} kept"
    elif found != kept:
        yield f"{place}: {found} today, {kept} kept"


@pytest.fixture(scope="module")
def example(repository):
    return repository / "reports" / "example"


def test_its_numbers_are_those_of_the_default_campaign(repository, example, tmp_path):
    flown = run_campaign(Request(repository / "campaigns" / "s_manoeuvre.yaml", tmp_path / "flown"))
    today = json.loads(json.dumps(make_numbers(read_results(flown.folder))))
    kept = json.loads((example / "report.json").read_text(encoding="utf-8"))
    without = [{key: value for key, value in numbers.items() if key not in BYTES} for numbers in (today, kept)]
    assert list(differences(*without)) == [], "make example"


def test_its_figures_are_there(example):
    text = (example / "report.md").read_text(encoding="utf-8")
    figures = sorted((example / "figures").glob("*.png"))
    assert len(figures) > 10
    assert all(f"figures/{figure.name}" in text for figure in figures)
