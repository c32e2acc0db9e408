"""A control law from a notebook's cell is the same as in a file, with its dependencies."""

import types

import numpy as np
import pytest

from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.one_flight.fly_once import make_document
from abhv_mc_vehicle.user_code.from_function import make_law_text
from abhv_mc_vehicle.user_code.load_law import load_law

CELLS = """
import math
from typing import NamedTuple

import numpy as np

from abhv_mc.extend import Command, clamp, controller, wrap

LIMIT = 0.2
ARRAY = np.ones(3)


class Settings(NamedTuple):
    path: float = 0.9
    bank_limit: float = 1.2


class Memory(NamedTuple):
    speed: float = 0.0


class Gains(NamedTuple):
    k: np.ndarray


def design(model, settings):
    return Gains(np.full(len(model.time), settings.path))


def helper(x):
    return clamp(x, -LIMIT, LIMIT) * math.pi


@controller(units={"bank_limit": "rad"})
def law(measured, reference, memory, settings, gains, dt):
    bank = wrap(measured.bank - reference.bank)
    command = Command(helper(-gains.k * bank), 0.0, reference.elevator, reference.equivalence_ratio)
    return command, Memory(memory.speed + dt * measured.speed)


def bare(measured, reference):
    return Command(-helper(measured.bank), 0.0, reference.elevator, reference.equivalence_ratio)


def array(measured, reference):
    return Command(ARRAY[0], 0.0, 0.0, 0.5)
"""


@pytest.fixture
def cells(monkeypatch):
    """Return the names of a notebook that has run these cells; its classes have no text."""
    import linecache
    import sys

    name = "<cell>"
    monkeypatch.setitem(
        linecache.cache, name, (len(CELLS), None, CELLS.splitlines(keepends=True), name)
    )
    module = types.ModuleType("a_notebook")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(CELLS, name, "exec"), module.__dict__)  # noqa: S102
    return module


def test_a_law_of_a_cell_is_taken_with_what_it_names(cells):
    text = make_law_text(cells.law)
    law = load_law(UserSource(text, "law.py"))
    assert law.mark.units == {"bank_limit": "rad"} and law.settings._field_defaults == {
        "path": 0.9,
        "bank_limit": 1.2,
    }
    assert law.design is not None and law.memory._fields == ("speed",)
    assert "bare" not in text
    homes = {line.split()[1] for line in text.splitlines() if line.startswith("from abhv_mc")}
    assert homes == {"abhv_mc.extend"}
    bare = load_law(UserSource(make_law_text(cells.bare), "bare.py"))
    assert bare.arguments == ("measured", "reference")
    measured, reference = (
        types.SimpleNamespace(bank=0.5),
        types.SimpleNamespace(elevator=0.0, equivalence_ratio=1.0),
    )
    assert bare.function(measured, reference)[0] == -0.2 * np.pi


def test_what_has_no_text_is_refused_by_name(cells):
    with pytest.raises(InputError, match="'ARRAY' of type ndarray"):
        make_law_text(cells.array)
    cells.wrap = types.SimpleNamespace(
        __module__="abhv_mc_vehicle.kernel.laws.lqr", __name__="wrap"
    )
    with pytest.raises(InputError, match=r"names of abhv_mc\.extend"):
        make_law_text(cells.law)
    with pytest.raises(InputError, match="a function"):
        make_document("vehicle", cells.law)
