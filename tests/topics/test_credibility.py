"""Credibility table with the factors of NASA-STD-7009 and evidence of the folder."""

from dataclasses import replace

import pytest

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.topics.provenance import credibility_fold
from abhv_mc.topics.topic import names_of


def test_the_table_has_eight_factors_and_leaves_the_assessment_to_the_user(flown):
    results = flown(16)
    (table,) = credibility_fold(names_of(results)).items[1:]
    rows = dict(table.plain_rows())
    assert list(rows) == [
        "Verification",
        "Validation",
        "Input pedigree",
        "Results uncertainty",
        "Results robustness",
        "Use history",
        "M&S management",
        "People qualifications",
    ]
    assert rows["Validation"].startswith("None") and "not" in rows["People qualifications"].lower()
    assert rows["Results uncertainty"].startswith("Flights: 16 (random)")
    assert f"Dispersed inputs: {len(results.dispersed)};" in rows["Input pedigree"]
    assert results.manifest.campaign_hash[:12] in rows["M&S management"]


@pytest.mark.parametrize(
    ("required", "judged", "is_stated"), [(1, 1, True), (0, 1, False), (1, 0, False)]
)
def test_a_risk_is_stated_only_for_verdicts(flown, monkeypatch, required, judged, is_stated):
    names = names_of(flown(16))
    names = replace(names, requirements=names.requirements[:required])
    monkeypatch.setattr(Experiment, "judged", bool(judged))
    rows = dict(credibility_fold(names).items[1].plain_rows())
    assert ("risk: 10" in rows["Results uncertainty"]) == is_stated
    assert rows["M&S management"].count("0 of 1") == required
