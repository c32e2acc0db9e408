"""Bad files: exit code 2, location, value found and value expected; no files created.

Random mistakes are accepted or rejected with an error; no reader fails in another way.
"""

import copy
import json
import random
import re
import shutil
from pathlib import Path

import pytest

from abhv_mc.io.documents import read_document
from abhv_mc.io.input_files import reading_once
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_campaigns, shipped_configs
from abhv_mc_vehicle import check_inputs
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

BAD = Path(__file__).parent / "bad"

# File, line, column, what the message must say.
TABLE = [
    ("unknown_parameter", 10, 3, ["'aero.lfit'", "'aero.lift'"]),
    ("no_effect", 10, 3, ["'aero.side_force.elevator'"]),
    ("missing_controller", 4, 20, ["tcl.yaml' "]),
    ("empty_range", 9, 63, [" 1.1 ", " 0.9"]),
    ("not_positive_definite", 13, 3, ["definite", "normal: "]),
    ("everything_at_once", 3, 10, [f":{line}: " for line in ("5:1", "6:7", "11:60")]),
    ("all_that_does_not_fit", 7, 3, [f":{line}: " for line in ("8:50", "10:14", "11:82", "12:42")]),
    ("rate", 12, 26, ["33 Hz"]),
    ("variants", 7, 37, ["'5 m'", ":7:", "'dampings'", ":8:", ":9:", "vary(vehicle=", "'tlx'"]),
]


@pytest.mark.parametrize(("name", "line", "column", "message"), TABLE)
def test_refused(name, line, column, message, abhv_mc, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = BAD / f"{name}.yaml"
    code, _, errors = abhv_mc("run", file)
    assert code == 2
    assert f"{file}:{line}:{column}: " in errors
    for word in message:
        assert word in errors
    assert not list(tmp_path.iterdir())


OTHERS = (
    None, True, -1, 0, 0.5, 10**12, "", "-", "~", "5 furlongs", "120 %", "1e400 m", "no such thing",
    "all", "level.yaml", "../configs/mission/level.yaml", [], {}, [[]], [1, "a"],
    {"a": 1, "b": [2]}, {"looks": [100, 200]},
    {"distribution": {"kind": None}}, [{"metric": "x"}],
)  # fmt: skip


def places(data, keys=()):
    """Yield the keys of every value of a document except the root."""
    inner = (
        data.items()
        if isinstance(data, dict)
        else enumerate(data)
        if isinstance(data, list)
        else ()
    )
    for key, value in inner:
        yield (*keys, key)
        yield from places(value, (*keys, key))


def mutants(campaign):
    """Yield a campaign unchanged, then 88 times with one of its values replaced."""
    chance, original = random.Random(campaign.stem), read_document(campaign).data
    yield "", json.dumps(original)
    for keys in chance.choices(list(places(original)), k=88):
        data = copy.deepcopy(original)
        around = data
        for key in keys[:-1]:
            around = around[key]
        around[keys[-1]] = other = chance.choice(OTHERS)
        yield f"{keys} {other}", json.dumps(data)


QUICK = ("s_manoeuvre", "failures")
CAMPAIGNS = [
    pytest.param(path, id=path.stem, marks=() if path.stem in QUICK else pytest.mark.thorough)
    for path in sorted(shipped_campaigns().glob("*.yaml"))
]


@pytest.mark.parametrize("campaign", CAMPAIGNS)
def test_a_replaced_value_is_taken_or_refused_with_its_place(
    campaign, tmp_path, abhv_mc, monkeypatch
):
    """Regression: a mapping in place of a number caused 2,500 lines of traceback."""
    monkeypatch.setattr(check_inputs, "_try_law", lambda *_: [])
    (tmp_path / "configs").symlink_to(shipped_configs())
    (tmp_path / "campaigns").mkdir()
    refused = 0
    with reading_once():
        for number, (mutant, text) in enumerate(mutants(campaign)):
            path = tmp_path / f"campaigns/{number}.yaml"
            path.write_text(text, encoding="utf-8")
            code, _, errors = abhv_mc("validate", path)
            assert code == 0 or (code == 2 and mutant), (mutant, errors)
            if code == 2:
                refused += 1
                # A path in place of metrics or requirements is read; the error is in its file.
                assert re.match(rf"{re.escape(str(tmp_path))}\S+:\d+:\d+: ", errors), (
                    mutant,
                    errors,
                )
                assert errors.count("\n") < 30, (mutant, errors)
    assert refused > 30


def test_a_file_of_another_kind_is_one_sentence(tmp_path, abhv_mc):
    text = (
        (shipped_campaigns() / "s_manoeuvre.yaml")
        .read_text()
        .replace("../configs", str(shipped_configs()))
    )
    path = tmp_path / "c.yaml"
    path.write_text(
        re.sub("mission: .*", f"mission: {shipped_configs()}/control/tlc.yaml", text),
        encoding="utf-8",
    )
    line = text[: text.index("mission:")].count("\n") + 1
    for command, file, message in (
        ("validate", path, f":{line}:10: 'tlc.yaml' "),
        ("run", path, f":{line}:10: 'tlc.yaml' "),
        (
            "run",
            shipped_configs() / "mission/level.yaml",
            "campaign file",
        ),
    ):
        code, _, errors = abhv_mc(command, file)
        assert code == 2 and errors.count("\n") == 1 and message in errors, errors


READERS = {
    "configs/mission/s_manoeuvre.yaml": read_mission,
    "configs/control/tlc.yaml": read_controller,
    "configs/vehicle/ghame_x.yaml": load_vehicle,
}
SNIPPETS = [
    *b"-1 1e400 .nan ~ { ] *a !!x '".split(),
    b"\t",
    b"\x00",
    b"\xff",
    b"\r",
    b"\n---\n",
    b"",
]


@pytest.fixture(scope="module")
def copies(tmp_path_factory):
    root = tmp_path_factory.mktemp("copies")
    shutil.copytree(shipped_configs(), root / "configs")
    return root


def is_refused(read, file, content):
    """Return whether a reader rejects the file with an InputError."""
    original = file.read_bytes()
    file.write_bytes(content)
    try:
        read()
    except InputError:
        return True
    finally:
        file.write_bytes(original)
    return False


def broken(file, number):
    """Return the content cut at a random offset, with a random snippet inserted."""
    chance, content = random.Random(f"{file.name} {number}"), file.read_bytes()
    offset = chance.randrange(len(content))
    return (
        content[:offset]
        + chance.choice(SNIPPETS)
        + content[offset + chance.choice([0, 1, 9, 10**6]) :]
    )


@pytest.mark.thorough
@pytest.mark.parametrize("name", READERS)
def test_a_mutated_file_is_taken_or_refused_in_words(copies, name):
    file = copies / name
    contents = [text.encode() for _, text in mutants(file)] + [broken(file, k) for k in range(60)]
    assert sum(is_refused(lambda: READERS[name](file), file, content) for content in contents) > 60
    tables = sorted(file.parent.glob("ghame/*.csv"))  # of the vehicle
    for k, table in enumerate(3 * tables):
        is_refused(lambda: load_vehicle(file), table, broken(table, k))
