"""Credibility assessment of a campaign's results by the factors in NASA-STD-7009."""

from collections.abc import Iterator

from abhv_mc.topics.formatting import count_of, fixed, percent
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Cell, Fold, Table, Text

_TEXT = (
    "The table lists the evidence in this folder for the credibility factors of NASA-STD-7009. The "
    "user must assess it and add further evidence."
)


def credibility_fold(names: Names) -> Fold:
    """Return the table of the eight credibility factors."""
    rows = tuple((Cell(name, head=True), Cell(evidence)) for name, evidence in _factors(names))
    title = "Credibility (NASA-STD-7009)"
    heads = ("Factor", "Evidence in this folder")
    return Fold(title, (Text(_TEXT), Table(title, heads, (rows,), numbers=False)))


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
    sampled = f"Flights: {fixed(manifest.runs_done, 0)} ({campaign.sampling})"
    risks = sorted({item.consumer_risk for item in required})
    if required and campaign.judged:
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
