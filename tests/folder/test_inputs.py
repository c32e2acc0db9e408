"""Content of input files, and inputs that a folder stores."""

import hashlib

import pytest

from abhv_mc.folder.inputs import FolderInputs, content_of, describe_changes, merge_inputs
from abhv_mc.io.documents import read_document

LIMITS = [
    {"metric": "miss", "below": 5, "probability": 0.9},
    {"metric": "miss", "below": 7, "probability": 0.99},
]


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".py", ".csv"])
def test_comments_are_content_of_tables_only(tmp_path, suffix):
    first, second, third = (tmp_path / f"{name}{suffix}" for name in "abc")
    separator = "=" if suffix == ".py" else ":"
    first.write_text(f"a{separator} 1\n")
    second.write_text(f"# remark\na{separator} 1\n")
    third.write_text(f"a{separator} 2\n")
    same = content_of(first) == content_of(second)
    assert same == (suffix != ".csv") and content_of(first) != content_of(third)
    if not same:
        assert content_of(first) == hashlib.sha256(first.read_bytes()).hexdigest()


@pytest.fixture
def make(tmp_path):
    """Return a function that makes inputs with the entries and the hashes of files."""

    def make_inputs(hashes=(), **entries):
        data = {
            "name": "x",
            "runs": 9,
            "controllers": {"a": "inputs/controllers/a/a.yaml"},
            "under_test": ["a"],
            "requirements": LIMITS,
            **entries,
        }
        path = tmp_path / "campaign.yaml"
        path.write_text(repr(data).replace("'", '"'))
        return FolderInputs(read_document(path), {}, dict(hashes))

    return make_inputs


@pytest.mark.parametrize(
    ("requirements", "kept"),
    [
        (LIMITS[::-1], True),
        ([dict(reversed(entry.items())) for entry in LIMITS], True),
        ([LIMITS[0], LIMITS[0]], False),
        (LIMITS[:1], False),
        ([*LIMITS, LIMITS[0] | {"below": 6}], False),
    ],
)
def test_requirements_in_another_order_leave_the_stored_ones(make, requirements, kept):
    stored = make(seed=1)
    merged = merge_inputs(stored, make(seed=2, requirements=requirements), False).data
    texts = [[list(entry.items()) for entry in own] for own in (merged["requirements"], LIMITS)]
    assert (texts[0] == texts[1]) == kept and merged["seed"] == 2


def test_changes_of_entries_and_files_prevent_a_run_from_resuming(make):
    b = {"controllers": {name: f"inputs/controllers/{name}/{name}.yaml" for name in "ab"}}
    hashes = {"vehicle/v.yaml": "1", "controllers/a/a.yaml": "1", "controllers/b/b.yaml": "1"}
    before = {f"inputs/{name}": value for name, value in hashes.items()}
    after = before | {
        "inputs/controllers/a/a.yaml": "2",
        "inputs/controllers/b/b.yaml": "2",
        "inputs/mission/m.yaml": "1",
    }
    del after["inputs/vehicle/v.yaml"]
    stored = make(before, seed=1, **b)
    for runs, extensible, entries in (
        *((10, True, []), (9, False, [])),
        *((8, True, ["runs: 9 -> 8"]), (10, False, ["runs: 9 -> 10"])),
    ):
        requested = make(after, seed=1, runs=runs)
        assert describe_changes(stored, requested, extensible) == [
            *entries,
            "inputs/vehicle/v.yaml: removed",
            "inputs/mission/m.yaml: added",
            "inputs/controllers/a/a.yaml: different content",
        ]
    assert describe_changes(stored, make(before), True) == ["seed: 1 -> nothing"]
