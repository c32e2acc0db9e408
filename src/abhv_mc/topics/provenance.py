"""Provenance of results: campaign, program, machine, digests and hashes."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from abhv_mc.campaign.sampling.marginals import find_atoms
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.topics.credibility import credibility_fold
from abhv_mc.topics.formatting import significant
from abhv_mc.topics.names import Names, full_labels
from abhv_mc.topics.section import Cell, Fold, Section, Table, Text
from abhv_mc.topics.topic import Topic


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


def _rows(manifest: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    """Yield the flattened entries of the manifest as pairs of label and value."""
    for key, value in manifest.items():
        if key in _TOLD_ELSEWHERE:
            continue
        label = key.replace("_", " ")
        if isinstance(value, dict):
            yield from (
                (f"{label}: {inner.replace('_', ' ')}", _words(item))
                for inner, item in value.items()
            )
        else:
            yield label, _words(value)


def _words(value: object) -> str:
    if isinstance(value, float):
        return significant(value, 4)
    if isinstance(value, dict):
        return ", ".join(f"{key} {_words(item)}" for key, item in value.items())
    if isinstance(value, list | tuple):
        return " ".join(map(_words, value)) or "none"
    return "\N{EM DASH}" if value is None else str(value)


def _categories(names: Names) -> Iterator[tuple[str, str]]:
    """Yield how many values of each parameter of categories were drawn."""
    campaign = names.campaign
    for name, drawn in names.results.samples.items():
        if name in campaign.parameters and campaign.parameters[name].is_category:
            values = find_atoms(campaign.marginals[name]) if name in campaign.marginals else drawn
            yield name, f"{len(np.unique(drawn))} of {len(np.unique(values))} drawn"


def _section(_found: Provenance, names: Names) -> Section:
    rerun, manifest = "", names.results.manifest
    if names.campaign.can_rerun:
        rerun = (
            f"Reproduce this campaign with `abhv-mc run {names.folder}/campaign.yaml -o "
            "ANOTHER_FOLDER`; "
        )
        rerun += "the digest must match. "
    text = (
        f"{rerun}Remake this page with `abhv-mc report {names.folder}`. Check its numbers against "
        f"the data with `abhv-mc verify campaign {names.folder}`. `report.json` next to this page "
        "has every number unrounded and the SHA-256 of every source file."
    )
    rows = [*_rows(manifest.as_entries()), *_categories(names)]
    manifest_rows = tuple((Cell(key, head=True), Cell(value)) for key, value in rows)
    return Section(
        "Reproducibility",
        (
            Text(text),
            credibility_fold(names),
            Fold(
                "Provenance",
                (Table("Provenance", ("Item", "Value"), (manifest_rows,), numbers=False),),
            ),
        ),
    )


PROVENANCE = Topic("provenance", Provenance, compute_provenance, _section)
