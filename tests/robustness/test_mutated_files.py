"""Files with random mistakes: each is taken or refused in words, and no reader fails in another way.

A failure prints the seed and the mutated content; the same seed makes the same files.
"""

import random
import shutil
from pathlib import Path

import pytest

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import read_mission
from abhv_mc.io.input_error import InputError
from abhv_mc.user_code.vehicle_functions import load_vehicle

ROOT = Path(__file__).parents[2]
SEED = 81
READERS = {
    "configs/mission/s_manoeuvre.yaml": read_mission,
    "configs/control/tlc.yaml": read_controller,
    "configs/vehicle/ghame_x.yaml": load_vehicle,
}
SNIPPETS = [
    *("-1", "0", "1e7 m/s", "1e400", ".nan", ".inf", "-.inf", "0x10", "1e-300 m", "99999999999999999999", "null", "~"),
    *("{", "}", "[", "]", ": ", "- ", "&a ", "*a", "!!python/object:os.system ", "<<: ", "%", "'", '"', "|", ">", "\t"),
    *("\x00", "\ud7ff", "\ufeff", "\r", "é", "💥", "../../etc/passwd", "/dev/null", "true", "#", "\n---\n", "...\n"),
]


def mutate(text, chance):
    """One to four mistakes: bytes flipped, lines doubled, cut or filled with something odd."""
    for _ in range(chance.randint(1, 4)):
        lines = text.split("\n")
        line = chance.randrange(len(lines))
        head, colon, _ = lines[line].partition(":")
        place = chance.randrange(len(lines[line]) + 1)
        lines[line : line + 1] = chance.choice(
            [
                [lines[line], chance.choice(lines)],
                [],
                [f"{head}{colon} {chance.choice(SNIPPETS)}"],
                [lines[line][:place] + chance.choice(SNIPPETS) + lines[line][place:]],
                [" " * chance.randrange(6) + lines[line].lstrip()],
            ]
        )
        text = "\n".join(lines)
    return text if chance.random() < 0.7 else text[: chance.randrange(len(text) + 1)]


@pytest.fixture(scope="module")
def copies(tmp_path_factory):
    root = tmp_path_factory.mktemp("copies")
    for folder in ("configs", "campaigns"):
        shutil.copytree(ROOT / folder, root / folder)
    return root


def read_mutated(path, read, chance, seed):
    whole = path.read_bytes()
    content = mutate(whole.decode(), chance).encode("utf-8", "surrogatepass")
    if chance.random() < 0.2 and content:
        place = chance.randrange(len(content))
        content = content[:place] + bytes([chance.randrange(256)]) + content[place + 1 :]
    path.write_bytes(content)
    try:
        read()
    except InputError:
        return True
    except Exception as error:
        raise AssertionError(f"seed {seed}: {type(error).__name__}: {error}\n{content!r}") from error
    finally:
        path.write_bytes(whole)
    return False


@pytest.mark.parametrize("name", READERS)
def test_a_mutated_yaml_file_is_taken_or_refused_in_words(copies, name):
    refused = 0
    for k in range(60):
        seed = f"{SEED} {name} {k}"
        refused += read_mutated(copies / name, lambda: READERS[name](copies / name), random.Random(seed), seed)
    assert refused > 20


def test_a_mutated_table_is_taken_or_refused_in_words(copies):
    vehicle = copies / "configs/vehicle/ghame_x.yaml"
    tables = sorted((copies / "configs/vehicle/ghame").glob("*.csv"))
    refused = 0
    for k in range(60):
        seed = f"{SEED} table {k}"
        chance = random.Random(seed)
        refused += read_mutated(chance.choice(tables), lambda: load_vehicle(vehicle), chance, seed)
    assert refused > 20
