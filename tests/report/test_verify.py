import json
import shutil

import pytest
from report.synthetic import write_campaign

from abhv_mc.documents import InputError
from abhv_mc.report.verify import differences, verify_campaign


@pytest.fixture
def copy(report_folder, tmp_path):
    return shutil.copytree(report_folder, tmp_path / "copy")


def test_an_untouched_report_is_confirmed(report_folder):
    assert list(verify_campaign(report_folder)) == []


@pytest.mark.parametrize("name", ["flights/lqr-000000000-000000040.parquet", "envelopes.parquet", "samples.parquet"])
def test_one_flipped_byte_is_told(copy, name):
    path = copy / name
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)
    assert next(verify_campaign(copy)).startswith(f"files.{name}")


def test_one_altered_number_is_told(copy):
    path = copy / "report.json"
    numbers = json.loads(path.read_text(encoding="utf-8"))
    numbers["metrics"]["fuel_used_kg"]["controllers"]["lqr"]["q95"]["high"] += 1e-9
    path.write_text(json.dumps(numbers), encoding="utf-8")
    (found,) = verify_campaign(copy)
    assert found.startswith("metrics.fuel_used_kg.controllers.lqr.q95.high: ")


def test_a_folder_without_a_report_is_bad_input(tmp_path):
    with pytest.raises(InputError, match=r"report\.json"):
        list(verify_campaign(write_campaign(tmp_path / "c", runs=4)))


def test_differences_name_their_place():
    written, remade = {"a": [1, {"b": 2}], "c": 1}, {"a": [1, {"b": 3}], "d": 1}
    assert [line.split(":")[0] for line in differences(written, remade, "x")] == ["x.a[1].b", "x.c", "x.d"]
