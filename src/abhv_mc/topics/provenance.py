"""Provenance of results (program, machine, hashes), and their credibility by NASA-STD-7009."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from abhv_mc.campaign.sampling.marginals import find_atoms
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.io.messages import grouped_digits
from abhv_mc.topics.formatting import count_of, percent, significant
from abhv_mc.topics.topic import Fold, Names, Section, Table, Text, Topic, full_labels, make_row


@dataclass(frozen=True)
class Provenance:
    """Identity and origin of a campaign's numbers."""

    name: str
    question: str
    runs: int
    seed: int
    sampling: str
    controllers: tuple[str, ...]
    labels: Mapping[str, str]
    stops_when_proven: bool
    pooled_seeds: tuple[int, ...]  # seeds of the campaigns merged into this one
    independent_flights: bool
    digests: Mapping[str, str]  # digests by controller


def compute_provenance(results: FlownCampaign) -> Provenance:
    """Return the provenance of results from the campaign file and the manifest."""
    campaign, manifest = results.campaign, results.manifest
    return Provenance(
        **{key: getattr(campaign, key) for key in ("name", "question", "runs", "seed", "sampling")},
        controllers=results.controllers,
        labels=full_labels(results.folder, results.controllers),
        stops_when_proven=campaign.model.stop is not None,
        pooled_seeds=campaign.pooled_seeds,
        independent_flights=campaign.independent,
        digests=manifest.digests,
    )


_TOLD_ELSEWHERE = (
    "controllers", "requirements", "requirements_shown", "files", "inputs", "campaign_hash",
    "source_hash", "question", "digests",
)  # fmt: skip


def _words(value: object) -> str:
    if isinstance(value, float):
        return significant(value, 4)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_words(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return " ".join(map(_words, value)) or "none"
    return "\N{EM DASH}" if value is None else str(value)


_CREDIBILITY = (
    "The table lists the evidence in this folder for the credibility factors of NASA-STD-7009. The "
    "user must assess it and add further evidence."
)


def credibility_fold(names: Names) -> Fold:
    """Return the table of the eight credibility factors."""
    rows = tuple(make_row(*factor) for factor in _factors(names))
    title = "Credibility (NASA-STD-7009)"
    heads = ("Factor", "Evidence in this folder")
    return Fold(title, (Text(_CREDIBILITY), Table(title, heads, (rows,), numbers=False)))


def _factors(names: Names) -> Iterator[tuple[str, str]]:
    campaign, manifest = names.campaign, names.results.manifest
    version = manifest.versions.get("abhv_mc", "")
    verified = f"abhv-mc {version} computed the statistics; the simulator is the user's."
    if not campaign.can_rerun:
        verified = f"abhv-mc {version} computed the statistics; the flights come from a table."
    elif campaign.simulator.mission:
        verified = f"abhv-mc {version}. `make verify` in a checkout compares with published data."
    if manifest.repeatable is not None:
        verified += f" {manifest.repeatable.sentence}"
    yield "Verification", verified
    yield (
        "Validation",
        f"None. `abhv-mc place FLIGHT.csv {names.folder}` compares test flights with these.",
    )
    unknowns = campaign.unknowns
    yield (
        "Input pedigree",
        f"Dispersed inputs: {len(names.results.dispersed)}; unknowns: {len(unknowns.names)}, "
        f"points: {len(unknowns.points)}; input files with SHA-256: {len(manifest.inputs)}. "
        "Sources of the distributions are not recorded.",
    )
    required = names.requirements
    sampled = f"Flights: {grouped_digits(manifest.runs_done)} ({campaign.sampling})"
    if required and campaign.judged:
        risks = sorted({item.consumer_risk for item in required})
        risk = ", ".join(percent(risk, 2) for risk in risks)
        sampled += f"; consumer's risk: {risk}, valid for repeated checks"
    yield "Results uncertainty", f"{sampled}. Uncertainty of the model itself is not included."
    yield (
        "Results robustness",
        "This report lists the drivers of each error. `abhv-mc worst` searches for worst cases, "
        "and `abhv-mc rare` for rare failures.",
    )
    started = f"Run {manifest.started}. " if manifest.started else ""
    yield "Use history", f"{started}Earlier uses are not recorded."
    traced = sum(bool(item.traced) for item in required)
    management = f"Commit {manifest.commit or 'not known'}; campaign {manifest.campaign_hash[:12]}"
    if required:
        management += f"; requirements traced to a source: {count_of(traced, len(required))}"
    yield "M&S management", f"{management}. The manifest contains the SHA-256 of every file."
    yield "People qualifications", "Not recorded."


def _section(_found: Provenance, names: Names) -> Section:
    rerun = (
        f"Reproduce this campaign with `abhv-mc run {names.folder}/campaign.yaml -o "
        "ANOTHER_FOLDER`; the digest must match. "
    ) * names.campaign.can_rerun
    text = (
        f"{rerun}Remake this page with `abhv-mc report {names.folder}`. Check its numbers against "
        f"the data with `abhv-mc verify campaign {names.folder}`. `report.json` next to this page "
        "has every number unrounded and the SHA-256 of every source file."
    )
    campaign, rows = names.campaign, []
    for key, value in names.results.manifest.as_entries().items():
        if key not in _TOLD_ELSEWHERE:
            inner = value if isinstance(value, dict) else {"": value}
            for name, item in inner.items():
                label = f"{key}: {name}".removesuffix(": ").replace("_", " ")
                rows.append((label, _words(item)))
    for name, drawn in names.results.samples.items():
        if name in campaign.parameters and campaign.parameters[name].is_category:
            values = find_atoms(campaign.marginals[name]) if name in campaign.marginals else drawn
            rows.append((name, f"{len(np.unique(drawn))} of {len(np.unique(values))} drawn"))
    group = tuple(make_row(*row) for row in rows)
    table = Table("Provenance", ("Item", "Value"), (group,), numbers=False)
    items = Text(text), credibility_fold(names), Fold(table.title, (table,))
    return Section("Reproducibility", items)


PROVENANCE = Topic("provenance", Provenance, compute_provenance, _section)
