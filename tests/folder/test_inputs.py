"""Content of input files, and inputs that a folder stores."""

import hashlib
import os
from dataclasses import replace

import pytest

from abhv_mc.folder.inputs import FolderInputs, content_of, describe_changes, merge_inputs
from abhv_mc.folder.layout import CampaignFolder
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


def test_copies_of_programs_remain_executable(make, tmp_path):
    copies = {"inputs/a": b"x", "inputs/b": b"y"}
    inputs = replace(make(), copies=copies, executables=frozenset({"inputs/a"}))
    inputs.write_copies(CampaignFolder(tmp_path / "out"))
    files = [tmp_path / "out" / name for name in copies]
    assert [file.read_bytes() for file in files] == [b"x", b"y"]
    assert [os.access(file, os.X_OK) for file in files] == [True, False]


def test_hashes_of_inputs_leave_out_what_may_differ(make):
    """Requirements are no part of a campaign's identity; seeds and numbers none of its question."""
    files = {"inputs/a": "1"}
    first = make(files, seed=1)
    for other, identity, question, judged in (
        (make(files, seed=1), True, True, True),
        (make(files, seed=1, requirements=LIMITS[:1]), True, True, False),
        (make(files, seed=2), False, True, False),
        (make(files, seed=1, runs=10), False, True, False),
        (make({"inputs/a": "2"}, seed=1), False, False, False),
    ):
        assert (first.identity == other.identity) == identity
        assert (first.question == other.question) == question
        assert (first.judged_identity == other.judged_identity) == judged
    unknowns = {"unknowns": {"a": {"low": 1, "high": 2}}}
    questions = [make(files, seed=seed, **unknowns).question for seed in (1, 2, 1)]
    assert questions[0] == questions[2] != questions[1]


def test_other_controllers_of_a_folder_keep_their_requirements_and_tests(make):
    """Controller b is stored; c is new. Without a choice on the command line, b is not tested."""

    def files(names):
        return {name: f"inputs/controllers/{name}/{name}.yaml" for name in names}

    bound = [LIMITS[0] | {"controllers": ["b"]}, LIMITS[1]]
    stored = make(controllers=files("ab"), under_test=["b"], requirements=bound)
    for selected, names, tested in ((True, "abc", ["b", "c"]), (False, "cab", ["c"])):
        new = [LIMITS[1] | {"below": 8}]
        requested = make(controllers=files("c"), under_test=["c"], requirements=new)
        merged = merge_inputs(stored, requested, selected).data
        assert [*merged["controllers"]] == [*names] and merged["under_test"] == tested
        asked = [(own["below"], own.get("controllers")) for own in merged["requirements"]]
        assert (5, ["b"]) in asked and {below for below, _ in asked} == {5, 8}
