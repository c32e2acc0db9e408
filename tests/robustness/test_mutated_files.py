"""Files with random mistakes: each is taken or refused in words, and no reader fails in another way."""

import random
import shutil
from pathlib import Path

import pytest
from campaign.file.test_bad_files import mutants

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import read_mission
from abhv_mc.io.input_error import InputError
from abhv_mc.user_code.vehicle_functions import load_vehicle

ROOT = Path(__file__).parents[2]
READERS = {
    "configs/mission/s_manoeuvre.yaml": read_mission,
    "configs/control/tlc.yaml": read_controller,
    "configs/vehicle/ghame_x.yaml": load_vehicle,
}
SNIPPETS = [*b"-1 1e400 .nan ~ { ] *a !!x '".split(), b"\t", b"\x00", b"\xff", b"\r", b"\n---\n", b""]


@pytest.fixture(scope="module")
def copies(tmp_path_factory):
    root = tmp_path_factory.mktemp("copies")
    shutil.copytree(ROOT / "configs", root / "configs")
    return root


def is_refused(read, file, content):
    """Whether a reader refuses in words; any other failure is one of the test's."""
    whole = file.read_bytes()
    file.write_bytes(content)
    try:
        read()
    except InputError:
        return True
    finally:
        file.write_bytes(whole)
    return False


def broken(file, number):
    """Its content cut anywhere, with an odd snippet in the place."""
    chance, content = random.Random(f"{file.name} {number}"), file.read_bytes()
    place = chance.randrange(len(content))
    return content[:place] + chance.choice(SNIPPETS) + content[place + chance.choice([0, 1, 9, 10**6]) :]


@pytest.mark.parametrize("name", READERS)
def test_a_mutated_file_is_taken_or_refused_in_words(copies, name):
    file = copies / name
    contents = [text.encode() for _, text in mutants(file)] + [broken(file, k) for k in range(60)]
    assert sum(is_refused(lambda: READERS[name](file), file, content) for content in contents) > 60
    tables = sorted(file.parent.glob("ghame/*.csv"))  # of the vehicle
    for k, table in enumerate(3 * tables):
        is_refused(lambda: load_vehicle(file), table, broken(table, k))
