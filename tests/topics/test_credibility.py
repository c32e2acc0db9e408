"""Credibility table with the factors of NASA-STD-7009 and evidence of the folder."""

from dataclasses import replace

import numpy as np
import pytest

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.sampling.marginals import DiscreteMarginal
from abhv_mc.topics.provenance import PROVENANCE, compute_provenance, credibility_fold
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


def test_the_evidence_is_counted(flown, monkeypatch):
    results = flown(16)
    first, second, third = results.campaign.requirements
    required = (
        replace(first, consumer_risk=0.2, traced={"id": "R1"}),
        replace(second, consumer_risk=0.05),
        replace(third, traced={"id": "R3"}),
    )
    manifest = replace(
        results.manifest,
        runs_done=12000,
        started="2031-01-02",
        commit=None,
        inputs=dict.fromkeys("abc", "0"),
        versions={"abhv_mc": "9.8.7"},
    )
    names = names_of(replace(results, manifest=manifest))
    names = replace(names, requirements=required)
    rows = dict(credibility_fold(names).items[1].plain_rows())
    assert "9.8.7" in rows["Verification"] and "make verify" in rows["Verification"]
    inputs = "Dispersed inputs: 3; unknowns: 0, points: 1; input files with SHA-256: 3."
    assert rows["Input pedigree"].startswith(inputs)
    thin = "\u202f"
    assert rows["Results uncertainty"].startswith(f"Flights: 12{thin}000 (random)")
    assert f"5{thin}%, 10{thin}%, 20{thin}%," in rows["Results uncertainty"]
    assert "2031-01-02" in rows["Use history"] and "2 of 3" in rows["M&S management"]
    assert "Commit not known;" in rows["M&S management"]
    later = replace(names, results=replace(results, manifest=replace(manifest, started=None)))
    assert "None" not in dict(credibility_fold(later).items[1].plain_rows())["Use history"]
    monkeypatch.setattr(Experiment, "can_rerun", False)
    imported = dict(credibility_fold(names).items[1].plain_rows())["Verification"]
    assert "9.8.7" in imported and "make verify" not in imported


def test_entries_of_the_manifest_and_drawn_categories_have_rows(flown):
    results = flown(16)
    contents, parameters = results.campaign.contents, results.campaign.parameters
    records = tuple(
        replace(record, is_category=record.name in ("aero.lift", "aero.drag"))
        for record in parameters.records
    )
    contents = replace(contents, parameters=replace(parameters, records=records))
    shares = np.cumsum(np.full(5, 0.2))
    marginals = {"aero.lift": DiscreteMarginal(np.arange(5.0), shares)}
    campaign = replace(results.campaign, contents=contents, marginals=marginals)
    samples = {
        **results.samples,
        "aero.lift": np.arange(16.0) % 3,
        "aero.drag": np.arange(16.0) % 4,
    }
    versions, machine = {"abhv_mc": "9.8.7", "numpy": "2.0"}, {"cores": 4}
    entries = {"versions": versions, "machine": machine, "command": ("a", "b"), "warnings": ()}
    manifest = replace(results.manifest, wall_time_s=12.34567, **entries)
    changed = replace(results, campaign=campaign, samples=samples, manifest=manifest)
    section = PROVENANCE.section(compute_provenance(changed), names_of(changed))
    rows = dict(section.tables()[-1].plain_rows())
    assert (rows["aero.lift"], rows["aero.drag"]) == ("3 of 5 drawn", "4 of 4 drawn")
    assert "atmosphere.density" not in rows
    assert rows["versions: abhv mc"] == "9.8.7" and rows["machine: cores"] == "4"
    assert (rows["wall time s"], rows["command"], rows["warnings"]) == ("12.35", "a b", "none")
    assert rows["runs planned"] == rows["runs done"] == "16" and rows["seed"] == "2014"
    told = {
        "campaign hash",
        "source hash",
        "question",
        "digests",
        "requirements",
        "files",
        "inputs",
    }
    assert not {key.partition(":")[0] for key in rows} & told


@pytest.mark.parametrize("stop", [None, "proven"])
def test_the_origin_of_the_numbers_is_that_of_the_campaign(flown, monkeypatch, stop):
    results = flown(16)
    model = results.campaign.model.model_copy(update={"stop": stop})
    results = replace(results, campaign=replace(results.campaign, model=model))
    found = compute_provenance(results)
    assert (found.name, found.runs, found.seed, found.sampling) == (
        "synthetic_s", 16, 2014, "random")  # fmt: skip
    assert found.question == results.campaign.question
    assert found.controllers == ("tlc", "lqr", "lqr_retuned") and found.labels["tlc"] == "TLC"
    assert found.stops_when_proven is bool(stop)
    assert (found.pooled_seeds, found.independent_flights) == ((), True)
    assert found.digests == results.manifest.digests
    monkeypatch.setattr(Experiment, "independent", False)
    assert compute_provenance(results).independent_flights is False
