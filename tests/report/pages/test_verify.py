import json
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from report.few_figures import build_with
from report.synthetic import write_campaign

from abhv_mc.io.documents import InputError
from abhv_mc.report.pages.build import hash_files
from abhv_mc.report.pages.verify import differences, verify_campaign


@pytest.fixture
def copy(report_folder, tmp_path):
    return shutil.copytree(report_folder, tmp_path / "copy")


def test_an_untouched_report_is_confirmed(report_folder):
    assert list(verify_campaign(report_folder)) == []


@pytest.fixture
def small(tmp_path):
    """Files of a few flights, which are soon hashed many times."""
    folder = write_campaign(tmp_path / "small", runs=4)
    build_with(folder)
    return folder


def flipped(path, place):
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


def test_one_flipped_byte_is_told_wherever_it_is(small):
    """Every file that a number depends on, at 25 places from its first byte to its last."""
    written = json.loads((small / "report.json").read_text(encoding="utf-8"))["files"]
    held = {path.relative_to(small).as_posix() for path in small.rglob("*.parquet")} | {"campaign.yaml"}
    assert set(written) == held
    for name in held:
        path = small / name
        whole, size = path.read_bytes(), path.stat().st_size
        for place in {k * (size - 1) // 24 for k in range(25)}:
            flipped(path, place)
            assert next(verify_campaign(small)).startswith(f"files.{name}: "), place
            path.write_bytes(whole)
    assert list(verify_campaign(small)) == []


def test_a_byte_of_the_page_is_told_and_a_page_that_is_gone(copy):
    path = copy / "report.html"
    whole = path.read_bytes()
    flipped(path, path.stat().st_size // 2)
    assert next(verify_campaign(copy)).startswith("pages.report.html: ")
    path.unlink()
    assert next(verify_campaign(copy)).startswith("pages.report.html: ")
    path.write_bytes(whole)
    build_with(copy, page="md")
    assert list(json.loads((copy / "report.json").read_text(encoding="utf-8"))["pages"]) == ["report.html", "report.md"]
    assert list(verify_campaign(copy)) == []


def test_a_block_rewritten_with_another_number_is_told(copy):
    """Whoever hashes the files anew still has the digest against him."""
    name = "flights/lqr-000000000-000000040.parquet"
    table = pq.read_table(copy / name)
    column = table.schema.get_field_index("fuel_used_kg")
    values = table["fuel_used_kg"].to_numpy().copy()
    values[3] = np.nextafter(values[3], np.inf)
    pq.write_table(table.set_column(column, table.schema.field(column), pa.array(values)), copy / name)
    numbers = json.loads((copy / "report.json").read_text(encoding="utf-8"))
    numbers["files"] = hash_files(copy)
    (copy / "report.json").write_text(json.dumps(numbers), encoding="utf-8")
    assert "does not hold what was written" in next(verify_campaign(copy))


def test_samples_of_another_campaign_are_told(copy):
    """Whoever hashes the files anew still has the flights' own columns against him."""
    table = pq.read_table(copy / "samples.parquet")
    values = table[1].to_numpy().copy()
    values[7] = np.nextafter(values[7], np.inf)
    pq.write_table(table.set_column(1, table.schema.field(1), pa.array(values)), copy / "samples.parquet")
    numbers = json.loads((copy / "report.json").read_text(encoding="utf-8"))
    numbers["files"] = hash_files(copy)
    (copy / "report.json").write_text(json.dumps(numbers), encoding="utf-8")
    assert "other samples than those of samples.parquet" in next(verify_campaign(copy))


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


def test_a_bit_of_a_figure_or_of_the_numbers_is_told(copy):
    path = next((copy / "figures").glob("*.png"))
    flipped(path, path.stat().st_size // 2)
    assert next(verify_campaign(copy)).startswith(f"pictures.figures/{path.name}: ")
    flipped(path, path.stat().st_size // 2)
    path = copy / "report.json"
    path.write_text(path.read_text(encoding="utf-8").replace("\n ", "\n\t", 1), encoding="utf-8")
    assert next(verify_campaign(copy)).startswith("report.json: ")
