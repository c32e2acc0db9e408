"""Searches of a user's simulator find what the same algorithms find on the same function."""

import json
from pathlib import Path

import numpy as np
import pytest

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.search.methods.rare import choose_chains
from abhv_mc.search.methods.strata import Switched, estimate_switched
from abhv_mc.search.methods.subset import SubsetPlan
from abhv_mc.search.methods.worst import search_worst
from abhv_mc.search.rare import RareSettings, find_rare
from abhv_mc.search.search_flights import SearchRequest
from abhv_mc.search.severity import FAILS_ABOVE
from abhv_mc.search.space import make_space
from abhv_mc.search.worst import WorstSettings, find_worst

SOURCE = "def fly(inputs, settings):\n    return {'miss': inputs['a'] + 0.5 * inputs['b'] * inputs['b']}\n"
LIMIT = 7.0


def function(values: Floats) -> Floats:
    """The same, of values [flight, input]."""
    a, b = values.T
    return np.asarray(a + 0.5 * b * b)


@pytest.fixture
def campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    (tmp_path / "paraboloid.py").write_text(SOURCE)
    content = {
        "name": "paraboloid",
        "simulator": {"python": "paraboloid.py"},
        "inputs": {"a": {}, "b": {}},
        "dispersions": {name: {"distribution": "normal", "sigma": 1.0} for name in ("a", "b")},
        "metrics": {"miss": {}},
        "requirements": [{"metric": "miss", "below": LIMIT, "probability": 0.999}],
        "runs": 100,
        "seed": 3,
    }
    path = tmp_path / "paraboloid.yaml"
    path.write_text(json.dumps(content))
    return path


def test_worst_finds_what_it_finds_on_the_function(campaign: Path, tmp_path: Path) -> None:
    space = make_space(read_campaign(campaign))
    bounds = space.bounds(3.0)
    expected = search_worst(lambda points: function(space.from_box(points, bounds)), 2, 400, 3)
    found = find_worst(SearchRequest(campaign, tmp_path / "worst"), WorstSettings("miss", flights=400)).case
    assert np.array_equal(found.points, expected.points)
    assert found.value == expected.value
    assert np.array_equal(found.place, expected.place)


def test_rare_estimates_what_it_estimates_on_the_function(campaign: Path, tmp_path: Path) -> None:
    space, flights = make_space(read_campaign(campaign)), 8000

    def evaluate(points: Floats, on: Switched) -> Floats:
        return function(space.from_normal(points, on)) - LIMIT

    plan = SubsetPlan(2, FAILS_ABOVE, 3, choose_chains(flights))
    expected, _ = estimate_switched(evaluate, np.array([]), plan, 0.2, flights)
    found = find_rare(SearchRequest(campaign, tmp_path / "rare"), RareSettings("miss", 0.2, flights)).estimate
    assert found.refusal is None
    assert (found.probability, found.low, found.high) == (expected.probability, expected.low, expected.high)
    assert found.flights == expected.flights
