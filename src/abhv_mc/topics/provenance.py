"""How a campaign is flown again: what was asked, which program and machine flew it, and its bytes."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.topics.credibility import credibility_fold
from abhv_mc.topics.names import Names, full_labels
from abhv_mc.topics.section import Cell, Fold, Section, Table, Text
from abhv_mc.topics.topic import Topic
from abhv_mc.topics.words import significant


@dataclass(frozen=True)
class Provenance:
    """What the campaign is called and asks, and where its numbers come from."""

    name: str
    question: str
    runs: int
    seed: int
    sampling: str
    controllers: tuple[str, ...]
    labels: Mapping[str, str]
    stops_when_proven: bool
    pooled_seeds: tuple[int, ...]  # of the flights that a merge joined
    independent_flights: bool
    digests: Mapping[str, str]  # by controller


def compute_provenance(results: FlownCampaign) -> Provenance:
    """What the campaign file and the manifest say."""
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
    "controllers", "requirements", "requirements_shown", "files", "inputs", "campaign_hash", "source_hash", "question",
    "digests",
)  # fmt: skip


def _rows(manifest: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    """What the manifest says, flat, as pairs of words."""
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


def _section(_found: Provenance, names: Names) -> Section:
    title, again, manifest = "Where the numbers come from", "", names.results.manifest
    if names.campaign.can_rerun:
        title = "How to fly it again"
        again = f"To fly it again: `abhv-mc run {names.folder}/campaign.yaml -o ANOTHER_FOLDER`; "
        again += "the digest below must come out the same. "
    text = (
        f"{again}To make this page again: `abhv-mc report {names.folder}`. "
        f"To check every number on it against the data: `abhv-mc verify campaign {names.folder}`. `report.json` beside "
        "this page holds every number unrounded, and the SHA-256 of every file that it was made from."
    )
    made = tuple((Cell(key, head=True), Cell(value)) for key, value in _rows(manifest.as_entries()))
    return Section(
        title,
        (
            Text(text),
            credibility_fold(names),
            Fold("Provenance", (Table("Provenance", ("What", "Value"), (made,), numbers=False),)),
        ),
    )


PROVENANCE = Topic("provenance", Provenance, compute_provenance, _section)
