"""Files of every kind are recognised and checked, with what they name."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from abhv_mc.campaign.file.kinds import find_kind
from abhv_mc.cli.app import app
from abhv_mc.io.documents import InputError, InputErrors
from abhv_mc.shipped import shipped_campaigns, shipped_configs
from abhv_mc.simulators.check_inputs import check_inputs

SHIPPED = [
    *(("campaign", path) for path in sorted(shipped_campaigns().glob("*.yaml"))),
    *(("vehicle", path) for path in sorted(shipped_configs().glob("vehicle/*.yaml"))),
    *(("mission", path) for path in sorted(shipped_configs().glob("mission/*.yaml"))),
    *(("controller", path) for path in sorted(shipped_configs().glob("control/*.yaml"))),
]


@pytest.mark.parametrize(("kind", "path"), SHIPPED, ids=lambda part: getattr(part, "stem", part))
def test_shipped_files_are_valid(kind: str, path: Path) -> None:
    assert find_kind(path) == kind
    assert check_inputs(path)[0].kind == kind


def copy(folder: Path) -> Path:
    for name in ("configs", "campaigns"):
        shutil.copytree((shipped_configs() if name == "configs" else shipped_campaigns()), folder / name)
    return folder / "campaigns" / "s_manoeuvre.yaml"


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_everything_wrong_in_every_file_is_said(tmp_path: Path) -> None:
    campaign = copy(tmp_path)
    replace(tmp_path / "configs/mission/paper_s.yaml", "name:", "nmae:")
    replace(tmp_path / "configs/control/tlc.yaml", "law: tlc", "law: tcl")
    with pytest.raises(InputErrors) as caught:
        check_inputs(campaign)
    assert {Path(error.file).name for error in caught.value.errors} == {"paper_s.yaml", "tlc.yaml"}
    answer = CliRunner().invoke(app, ["validate", str(campaign)])
    assert isinstance(answer.exception, InputErrors)


def test_what_may_be_one_value_for_the_whole_programme_is_asked() -> None:
    names = ("s_manoeuvre", "wide", "s_manoeuvre_unknown")
    warned = {name: check_inputs(shipped_campaigns() / f"{name}.yaml")[0].warnings for name in names}
    assert warned["s_manoeuvre"][0].startswith("aero.lift, aero.drag: is this one value")
    assert "more: is this one value" in warned["wide"][0] and not warned["s_manoeuvre_unknown"]


def test_a_file_of_no_kind(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text("colour: red\n")
    with pytest.raises(InputError, match="campaign, vehicle, mission, controller"):
        find_kind(tmp_path / "x.yaml")
