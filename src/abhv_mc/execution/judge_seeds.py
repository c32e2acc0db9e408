"""Campaigns of one question, judged together: new seeds beside old ones are more flights, not another try."""

from collections.abc import Sequence
from typing import Any

from abhv_mc.campaign.file.check import CheckedCampaign
from abhv_mc.statistics.judgement import Pair, judge_pairs
from abhv_mc.statistics.verdicts import verdict_words

_ASKED = ("metric", "below", "above", "probability", "controller")


def judge_together(campaign: CheckedCampaign, manifests: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The first manifest's requirements with the counts and verdicts of the flights of all."""
    together = []
    for entry in manifests[0]["requirements"]:
        same = [
            other
            for manifest in manifests
            for other in manifest["requirements"]
            if all(other.get(key) == entry.get(key) for key in _ASKED)
        ]
        counted = ("flights", "failures", "failures_not_computed")
        together.append(entry | {key: sum(other[key] for other in same) for key in counted})
    pairs = []
    for entry in together:
        uncomputed, asked = entry["failures_not_computed"], ("probability", "consumer_risk", "producer_risk")
        risks = (entry[key] for key in asked)
        pairs.append(Pair(entry["failures"] - uncomputed, entry["flights"], uncomputed, *risks))
    model = campaign.model
    # Pairs that bind nobody are of the family, too: as if they showed nothing.
    others = len(model.requirements) * len(model.controllers) - len(pairs)
    pairs += [Pair(0, 0, 0, 0.5, 0.1)] * (others if model.family else 0)
    verdicts = judge_pairs(pairs, family_risk=model.family.risk if model.family else None)
    return [
        entry | {"verdict": verdict.status, "words": verdict_words(verdict)}
        for entry, verdict in zip(together, verdicts, strict=False)
    ]
