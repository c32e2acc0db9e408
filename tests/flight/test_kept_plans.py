"""A kept plan is the plan to the bit and to the type, and is never another one's."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numba import typeof

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import Recorded, read_mission
from abhv_mc.flight import kept_plans
from abhv_mc.flight import prepare as module
from abhv_mc.flight.kept_plans import find_plan_file, keep_plan, recall_plan
from abhv_mc.flight.prepare import prepare
from abhv_mc.plant.vehicles import load_vehicle

CONFIGS = Path(__file__).parents[2] / "configs"
VEHICLE, MISSION = CONFIGS / "vehicle" / "ghame_x.yaml", CONFIGS / "mission" / "s_manoeuvre.yaml"
CONTROLLERS = {name: CONFIGS / "control" / f"{name}.yaml" for name in ("tlc", "lqr")}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(kept_plans, "cache_folder", lambda: tmp_path)
    return tmp_path / "plans"


@pytest.fixture
def made(monkeypatch):
    """What has been made rather than recalled."""
    make, names = module.make_plan, []

    def watch(*arguments):
        names.append(arguments[3])
        return make(*arguments)

    monkeypatch.setattr(module, "make_plan", watch)
    return names


def same(one, other):
    """Equal to the bit; and of the types that numba knows kernels by."""
    for field in fields(one):
        left, right = getattr(one, field.name), getattr(other, field.name)
        if isinstance(left, str):
            assert left == right
        elif field.name == "warnings":
            assert left.tolist() == right.tolist()
        else:
            assert typeof(left) == typeof(right), field.name
            for a, b in zip(flat(left), flat(right), strict=True):
                np.testing.assert_array_equal(a, b)


def flat(value):
    return [leaf for each in value for leaf in flat(each)] if isinstance(value, tuple) else [value]


@pytest.mark.parametrize("name", ["tlc", "lqr"])
def test_a_recalled_plan_is_the_plan(name, made):
    first = prepare(VEHICLE, MISSION, CONTROLLERS[name], name)
    second = prepare(VEHICLE, MISSION, CONTROLLERS[name], "another name")
    assert made == [name] and second.controller == "another name"
    same(first, replace(second, controller=name))


def test_warnings_are_recalled(folder):
    plan = replace(prepare(VEHICLE, MISSION, CONTROLLERS["tlc"], "tlc"), warnings=np.array(["a", "much longer"]))
    file = folder / "one.npz"
    keep_plan(file, plan)
    assert recall_plan(file).warnings.tolist() == ["a", "much longer"]


def test_whatever_a_plan_is_made_from_counts(monkeypatch):
    vehicle, mission = load_vehicle(VEHICLE), read_mission(MISSION)
    tlc = read_controller(CONTROLLERS["tlc"])

    def file(vehicle=vehicle, mission=mission, controller=tlc):
        return find_plan_file(vehicle, mission, controller)

    tables = vehicle.tables._replace(data=vehicle.tables.data.copy())
    tables.data[-1] = np.nextafter(tables.data[-1], np.inf)
    limits = tlc.limits.model_copy(update={"bank": np.nextafter(tlc.limits.bank, 0.0)})
    files = {
        file(),
        file(vehicle=vehicle._replace(tables=tables)),
        file(vehicle=vehicle._replace(constants=vehicle.constants._replace(area=1.0))),
        file(mission=mission.model_copy(update={"duration": 59.0})),
        file(controller=tlc.model_copy(update={"limits": limits})),
        file(controller=read_controller(CONTROLLERS["lqr"])),
    }
    assert len(files) == 6 and file() == file()
    monkeypatch.setattr(kept_plans, "cache_folder", lambda: Path("of another source"))
    assert file() not in files


def test_a_mission_that_reads_another_file_is_not_kept(tmp_path):
    manoeuvre = Recorded.model_construct(kind="recorded", file=tmp_path / "track.csv")
    mission = read_mission(MISSION).model_copy(update={"manoeuvre": manoeuvre})
    assert find_plan_file(load_vehicle(VEHICLE), mission, read_controller(CONTROLLERS["tlc"])) is None


@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: data[: len(data) // 2], lambda data: b"x" + data])
def test_a_damaged_file_is_made_anew(folder, made, damage):
    first = prepare(VEHICLE, MISSION, CONTROLLERS["tlc"], "tlc")
    (file,) = folder.glob("*.npz")
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    same(first, prepare(VEHICLE, MISSION, CONTROLLERS["tlc"], "tlc"))
    assert len(made) == 2 and file.stat().st_size == len(whole)


def test_one_flipped_bit_is_noticed(folder, made):
    prepare(VEHICLE, MISSION, CONTROLLERS["tlc"], "tlc")
    (file,) = folder.glob("*.npz")
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    prepare(VEHICLE, MISSION, CONTROLLERS["tlc"], "tlc")
    assert len(made) == 2


def test_the_latest_are_kept(folder, monkeypatch):
    monkeypatch.setattr(kept_plans, "KEPT", 3)
    plan = prepare(VEHICLE, MISSION, CONTROLLERS["tlc"], "tlc")
    for i in range(5):
        keep_plan(folder / f"{i}.npz", plan)
    assert len(list(folder.glob("*"))) == 3 and (folder / "4.npz").exists()


def test_a_disk_that_takes_nothing_is_no_fault(folder, made):
    folder.write_text("a file where the folder would be")
    prepare(VEHICLE, MISSION, CONTROLLERS["tlc"], "tlc")
    prepare(VEHICLE, MISSION, CONTROLLERS["tlc"], "tlc")
    assert len(made) == 2
