import shutil

import pytest
from report.synthetic import write_campaign

from abhv_mc.io.documents import InputError
from abhv_mc.report.pages.verify import differences, verify_campaign


@pytest.fixture
def copy(report_folder, tmp_path):
    return shutil.copytree(report_folder, tmp_path / "copy")


def flipped(path, place):
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(("name", "place"), [("report.html", "pages"), ("figures/channels.png", "pictures")])
def test_a_bit_of_a_page_or_figure_is_told_and_one_that_is_gone(copy, name, place):
    flipped(copy / name, (copy / name).stat().st_size // 2)
    assert next(verify_campaign(copy)).startswith(f"{place}.{name}: ")
    (copy / name).unlink()
    assert next(verify_campaign(copy)).startswith(f"{place}.{name}: ")


def test_a_folder_without_a_report_is_bad_input(tmp_path):
    with pytest.raises(InputError, match=r"report\.json"):
        list(verify_campaign(write_campaign(tmp_path / "c", runs=4)))


def test_differences_name_their_place():
    written, remade = {"a": [1, {"b": 2}], "c": 1}, {"a": [1, {"b": 3}], "d": 1}
    assert [line.split(":")[0] for line in differences(written, remade, "x")] == ["x.a[1].b", "x.c", "x.d"]
