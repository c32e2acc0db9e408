"""A new folder is complete in itself."""

import json
from pathlib import Path

import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.inputs import check_inputs, find_kind
from abhv_mc.campaign.file.new_campaign import write_new_campaign
from abhv_mc.io.documents import InputError
from abhv_mc.shipped import shipped_campaigns


def test_new_folder_stands_alone(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "study"
    written = write_new_campaign(folder)
    assert {found.kind for found in check_inputs(written[0])} == {"campaign", "vehicle", "mission", "controller"}
    made, shipped = read_campaign(written[0]).model, read_campaign(shipped_campaigns() / "s_manoeuvre.yaml").model
    for file in (made.vehicle, made.mission, *made.controllers.values()):
        assert file.resolve().is_relative_to(folder)
    assert made.dispersions == shipped.dispersions
    assert "#" in written[0].read_text()


def test_editors_find_the_schema_of_every_file(tmp_path: Path) -> None:
    files = [file for file in write_new_campaign(tmp_path / "study") if file.suffix == ".yaml"]
    assert len(files) > 4
    for file in files:
        name = file.read_text().splitlines()[0].removeprefix("# yaml-language-server: $schema=")
        schema = json.loads((file.parent / name).read_text())
        assert schema["$id"].endswith(f":{find_kind(file)}")


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("precious")
    for folder in (tmp_path, tmp_path / "mine"):
        with pytest.raises(InputError, match="empty"):
            write_new_campaign(folder)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
