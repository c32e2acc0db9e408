"""A user's own table set that is wrong: validate and run name file and line, exit with 2 and write nothing."""

import shutil

import pytest

# File, what stands there (once), what is put there, line and column that must be named, words.
MISTAKES = [
    pytest.param("winged_cone/cl_re.csv", "\n4,-1,-10,0.0036434\n", "\n", 4, None, "a hole", id="hole"),
    pytest.param("winged_cone.yaml", "area: 3603 ft2", "area: 3603", 7, 9, "without a unit", id="area without unit"),
]


@pytest.fixture
def campaign(repository, tmp_path):
    """The winged cone's campaign with files of its own."""
    for name in ("configs", "campaigns"):
        shutil.copytree(repository / name, tmp_path / "files" / name)
    return tmp_path / "files/campaigns/winged_cone.yaml"


@pytest.mark.parametrize(("name", "old", "new", "line", "column", "words"), MISTAKES)
def test_validate_and_run_refuse_it(campaign, abhv_mc, monkeypatch, name, old, new, line, column, words):
    root = campaign.parents[1]
    path = root / "configs/vehicle" / name
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    place = f"/{path.name}:{line}:{column}: " if column else f"/{path.name}:{line}: "
    before = sorted(root.rglob("*"))
    monkeypatch.chdir(root)
    for command in (["validate", root / "configs/vehicle/winged_cone.yaml"], ["validate", campaign], ["run", campaign]):
        code, _, said = abhv_mc(*command)
        assert code == 2
        assert place in said
        assert words in said
    assert sorted(root.rglob("*")) == before
