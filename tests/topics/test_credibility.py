"""Credibility table with the factors of NASA-STD-7009 and evidence of the folder."""

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
