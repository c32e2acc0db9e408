"""Requirements from a CSV file are those that the campaign could list itself, with the places of the table."""

from pathlib import Path

import pytest
from fake_flight import write_campaign

from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.io.input_error import InputError

TABLE = """\
id,text,source,metric,below,above,probability,consumer_risk,controllers
GNC-12,"The altitude is held, always",SRD 3.2,altitude_error_max_m,50 m,,99.73 %,0.05,
GNC-13,,SRD 3.3,equivalence_ratio_min,,0.1,0.9,,one; two
"""


def campaign(folder, table, **entries):
    path = write_campaign(folder, requirements="requirements.csv", **entries)
    (folder / "requirements.csv").write_text(table, encoding="utf-8")
    return path


def test_a_table_reads_as_a_list(tmp_path):
    checked = read_campaign(campaign(tmp_path, TABLE))
    first, second = checked.model.requirements
    assert (first.id, first.text, first.source) == ("GNC-12", "The altitude is held, always", "SRD 3.2")
    assert [item.limits for item in checked.requirements] == [Bounds(high=50.0), Bounds(low=0.1)]
    assert first.probability == pytest.approx(0.9973)
    assert (first.consumer_risk, second.consumer_risk) == (0.05, 0.10)
    assert second.controllers == ("one", "two") and second.above == 0.1 and second.text is None
    assert read_campaign(tmp_path / "campaign.yaml", controllers=["two"]).model.requirements[1].controllers == ("two",)


def test_a_row_with_both_limits_is_one_requirement(tmp_path):
    table = TABLE.replace("equivalence_ratio_min,,0.1", "equivalence_ratio_min,0.5,0.1")
    assert read_campaign(campaign(tmp_path, table)).requirements[1].limits == Bounds(0.1, 0.5)
    with pytest.raises(InputError, match="below 0"):
        read_campaign(campaign(tmp_path, table.replace("0.5,0.1", "0.1,0.5")))


@pytest.mark.parametrize(
    ("old", "new", "line", "column"),
    [
        ("50 m", "50 furlongs", None, None),  # the metric's unit is the campaign's business
        ("99.73 %", "199 %", 2, 7),
        (",below,", ",belov,", 1, 5),
        ("equivalence_ratio_min,,0.1", "equivalence_ratio_min,,", 3, 1),
        ("one; two", "one, two", 3, 10),
    ],
)
def test_mistakes_are_told_with_line_and_column_of_the_table(tmp_path, old, new, line, column):
    with pytest.raises(InputError) as refused:
        read_campaign(campaign(tmp_path, TABLE.replace(old, new)))
    if line is not None:
        assert Path(refused.value.file) == tmp_path / "requirements.csv"
        assert (refused.value.line, refused.value.column) == (line, column)


def test_ids_are_told_apart(tmp_path):
    with pytest.raises(InputError, match="GNC-12"):
        read_campaign(campaign(tmp_path, TABLE.replace("GNC-13", "GNC-12")))
