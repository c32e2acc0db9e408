"""Tables and margins of a campaign's folder."""

import csv

import pytest
from report.synthetic import CONTROLLERS

from abhv_mc.folder.steady_margins import LoopMargins, read_steady_margins
from abhv_mc.folder.tables import export_csv, run_query
from abhv_mc.io.messages import InputError


def test_tables_are_exported_row_by_row(failing_folder, tmp_path):
    rows = {}
    for path in export_csv(failing_folder, tmp_path):
        with path.open(encoding="utf-8") as file:
            rows[path.stem] = list(csv.DictReader(file))
    counts = {name: len(rows[name]) for name in ("flights", "samples", "reference")}
    assert counts == {"flights": 100 * len(CONTROLLERS), "samples": 100, "reference": 601}


def test_the_gain_margin_is_the_smaller_of_both_sides(tmp_path):
    sides = [(-4.0, 6.0), (-9.0, None), (None, 5.0), (None, None)]
    margins = [LoopMargins("pitch", True, low, high).gain_db for low, high in sides]
    assert margins == [4.0, 9.0, 5.0, float("inf")]
    assert read_steady_margins(tmp_path / "margins.json").corners == 0


def test_queries_have_results_and_other_statements_have_none(failing_folder):
    def rows(relation):
        return relation.fetchall()

    sql = "select count(*) from flights where outcome != 'ok'"
    assert run_query(failing_folder, sql, rows) == [(12 * (len(CONTROLLERS) - 1),)]
    assert run_query(failing_folder, "-- nothing", rows) is None
    with pytest.raises(InputError, match="quote names"):
        run_query(failing_folder, "select lift from samples", rows)
    with pytest.raises(InputError, match="failed"):
        run_query(failing_folder, "from read_csv('x.csv')", rows)
