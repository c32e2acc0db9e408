"""Poles that are removed from a linear model by holding slow states."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc_vehicle.one_flight import linear_models


@pytest.mark.parametrize(
    ("free", "left", "removed"),
    [
        ([-1.0, -0.02, 0.003], [-1.1], ["-0.02", "+0.003"]),
        ([-0.5 + 2.0j, -0.5 - 2.0j, -3.0], [-3.0], ["-0.5 +- 2j"]),
        ([-2.0, -0.01 + 0.03j, -0.01 - 0.03j, 0.25], [-2.0, 0.3], ["-0.01 +- 0.03j"]),
        ([-4.0, -1.0], [], ["-4", "-1"]),
        ([-1.0, -1.02], [-1.0], ["-1"]),
    ],
)
def test_poles_without_a_near_pole_are_removed(monkeypatch, free, left, removed):
    poles = SimpleNamespace(poles=np.array([left], complex))
    monkeypatch.setattr(linear_models.systems, "linearize", lambda *_: None)
    monkeypatch.setattr(linear_models, "analyse", lambda *_, **__: poles)
    monkeypatch.setattr(linear_models, "closed_poles", lambda _: np.array([free], complex))
    place = SimpleNamespace(plan=SimpleNamespace(controller="own"), points=None)
    _, _, notes = linear_models.analyse_place(place, ["altitude"])
    assert re.findall(r"[+-]\d[\d.]*(?: \+- [\d.]+j)?", " ".join(notes)) == removed
