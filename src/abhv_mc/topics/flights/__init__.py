"""What was flown and how it ended, the linked view of the flights, and tables of the worst ones."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.unknowns import unknowns_hint
from abhv_mc.folder.flown_campaign import kept_flights
from abhv_mc.topics.flights.model import (
    FlightCounts,
    Flights,
    InputMoments,
    LargeDispersion,
    WorstFlight,
    compute_flights,
    ended_words,
)
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Cell, Fold, Item, Picture, Row, Section, Table, Text, Widget
from abhv_mc.topics.topic import Topic, figures_of
from abhv_mc.topics.words import (
    count_of,
    fixed,
    joined,
    parameter_doc,
    shown_value,
    significant,
    spoken_name,
)


def flight_sentences(found: Flights, names: Names, off_cards: bool = False) -> Sequence[str]:
    """Flights not computed, lost, cycling, saturated, off the tables; ``off_cards``: as no card shows them."""
    said = [
        f"{name}: the machine could compute none of {count} flights, so it is not in this report; it met nothing."
        for name, count in found.left_out.items()
    ]
    for name, part in found.findings.items():
        counts, swings = (
            found.counts[name],
            "swings, in gusts, turbulence or noise," if part.disturbed else "limit cycle",
        )
        known = [("the vehicle's tables are left in", part.outside_tables, part.flown)]
        if not off_cards:
            cycles = [(f"{swings} (> {part.ripple_deg:g} deg) in {channel.replace('_', ' ')} in", count, part.flown)
                      for channel, count in part.cycling.items()]  # fmt: skip
            known = [
                ("the machine could not compute", counts.not_computed, counts.flown + counts.not_computed),
                ("ended early:", counts.failed, counts.flown),
                ("surfaces reach a limit of deflection or rate in", part.saturated, part.flown), *cycles, *known,
            ]  # fmt: skip
        words = [
            f"{text} {count_of(count, flown, 'flights')}" for text, count, flown in known if count
        ]
        said += [f"{names.label(name)}: {'; '.join(words)}."] if words else []
    return said


def flight_section(found: Flights, names: Names) -> Section:
    """All of it; the linked view stands on a page alone."""
    return Section("What each flight did", tuple(_items(found, names)))


def _items(found: Flights, names: Names) -> Iterator[Item]:
    campaign = names.campaign
    yield Text(_flown(found, campaign, names))
    if found.dispersions:
        rows = [
            _dispersion(name, _law(entry), _settings(entry), names)
            for name, entry in found.dispersions.items()
        ]
        rows += [_dispersion(name, "derived", text, names) for name, text in found.derived.items()]
        yield Table(
            "Dispersions",
            ("Parameter", "Meaning", "Distribution", "Settings"),
            (tuple(rows),),
            numbers=False,
        )
    if found.inputs:
        yield Table(
            "Mean and spread (standard deviation) of the inputs, as stated and as found in the table",
            ("Input", "Unit", "Stated mean", "Found mean", "Stated spread", "Found spread"),
            (tuple(_moments(name, found.inputs[name], names) for name in found.inputs),),
        )
    if any(entry.failed or entry.not_computed for entry in found.counts.values()):
        heads = (campaign.kind.capitalize(), "Flown", "Ended early", "Not computed", "Outcomes")
        counts = tuple(_counts(names.label(name), entry) for name, entry in found.counts.items())
        yield Table("How the flights ended", heads, (counts,), numbers=False)
    else:
        yield Text("No flight ended early.")
    yield Widget("flights")
    kept = (
        "Their histories are kept: a number draws it" if campaign.channels else "A number opens it"
    )
    words = (
        "Sorted by severity: early terminations first, the earliest before all others, then by exceedance of a limit "
        "in percent of it (without requirements, of the median); below zero the limit is met. "
        f"{kept} above; on paper the first five are listed."
    )
    if campaign.can_rerun:
        words += f" `abhv-mc explain {names.folder} --controller NAME --flight NUMBER` finds the smallest set of "
        words += "dispersions that still makes a flight fail."
    yield Text(words + _kept_words(names))
    asked = (names.metrics[metric].label_with_unit for metric in names.asked)
    worst_heads = (
        "Flight",
        "Outcome",
        "Worst in",
        f"Exceedance (% of {'limit' if any(c.limits for c in campaign.criteria) else 'median'})",
        *asked,
        "Largest dispersions",
    )
    for name, flights in found.worst.items():
        title = f"Worst flights of {names.label(name)}"
        again = f"Again, bit for bit: `abhv-mc replay {names.folder} --controller {name} --flight NUMBER`"
        listed = tuple(_worst(name, each, names) for each in flights)
        table = Table(title, worst_heads, (listed,)).without_constant()
        yield Fold(title, (Text(again), table) if campaign.can_rerun else (table,))
    yield Picture("worst_flights")


def _kept_words(names: Names) -> str:
    """Return how many of the worst flights have histories, if requirements were changed and not all have."""
    results, number = names.results, names.campaign.worst
    if not (results.requirement_changes and number and names.campaign.channels):
        return ""
    worst = {
        name: results.flights[name].flight[results.ranking.rows_of(name)[:number]]
        for name in results.controllers
    }
    total = sum(flights.size for flights in worst.values())
    kept = sum(
        len(kept_flights(results.folder, name).intersection(flights.tolist()))
        for name, flights in worst.items()
    )
    if kept == total:
        return ""
    return f" {kept} of the {total} worst flights by these limits have histories; `abhv-mc run` makes the rest."


def _flown(found: Flights, campaign: Experiment, names: Names) -> str:
    flown = fixed(next(iter(found.counts.values())).flown, 0)
    text = f"{joined(list(names.controllers.values()))} flew {'the same ' if len(names.controllers) > 1 else ''}{flown}"
    text += " dispersed flights"
    if campaign.model.stop:
        text += f" (at most {fixed(campaign.runs, 0)}; it stops when proven)"
    seeds = f"seeds {', '.join(map(str, campaign.pooled_seeds))} one after the other"
    if origin := campaign.simulator.origin:
        claim = (
            "No test contradicts that they are" if campaign.independent else "They are not taken as"
        )
        return (
            f"{text}, imported from {origin}. {claim} independent draws of the stated dispersions. "
        )
    text += f" ({campaign.sampling.replace('_', ' ')} sampling, "
    text += f"{seeds if campaign.pooled_seeds else f'seed {campaign.seed}'}). "
    if found.dispersions:
        count, unknowns = len(found.dispersions) - len(campaign.unknowns.names), campaign.unknowns
        if unknowns.names:
            text += f"Each sample flew at each of {len(unknowns.points)} values of the unknowns. "
        text += f"Each flight drew {count} parameter{'s' if count != 1 else ''} as listed here; nothing else differed "
        text += "from the nominal flight. "
        hint = unknowns_hint(name for name in found.dispersions if name not in unknowns.names)
        text += f"{hint} " if hint else ""
    return text + (
        "A flight that ended early counts as a failure in every statistic and verdict, unless a requirement says "
        "otherwise; both counts are shown."
    )


def _law(entry: Mapping[str, Any]) -> str:
    return str(entry.get("distribution", "")).replace("_", " ")


def _settings(entry: Mapping[str, Any]) -> str:
    rest = {key: value for key, value in entry.items() if key not in ("distribution", "parts")}
    parts = [f"{_law(part)} ({_settings(part)})" for part in entry.get("parts", ())]  # of a mixture
    return ", ".join([*parts, *(f"{key.replace('_', ' ')} {value}" for key, value in rest.items())])


def _dispersion(name: str, law: str, settings: str, names: Names) -> Row:
    return (
        Cell(f"`{name}`", head=True),
        Cell(parameter_doc(name, names.campaign.parameters)),
        Cell(law),
        Cell(settings),
    )


def _moments(name: str, found: InputMoments, names: Names) -> Row:
    means = (significant(mean, 6) for mean in (found.stated_mean, found.mean))
    spreads = (significant(sigma, 4) for sigma in (found.stated_sigma, found.sigma))
    unit = names.campaign.parameters[name].unit
    return (Cell(f"`{name}`", head=True), *map(Cell, (unit, *means, *spreads)))


def _counts(label: str, found: FlightCounts) -> Row:
    outcomes = joined(
        [f"{count} {code.replace('_', ' ')}" for code, count in found.outcomes.items()]
    )
    numbers = (fixed(count, 0) for count in (found.flown, found.failed, found.not_computed))
    return (Cell(label, head=True), *map(Cell, numbers), Cell(outcomes))


def _worst(controller: str, found: WorstFlight, names: Names) -> Row:
    values = (significant(found.metrics.get(metric), 6) for metric in names.asked)
    return (
        Cell(str(found.flight), head=True, flight=(controller, found.flight)),
        Cell(ended_words(found.outcome, found.missed, len(names.requirements))),
        Cell(names.metrics[found.by].label if found.by else ""),
        Cell(significant(100.0 * found.beyond, 3)),
        *map(Cell, values),
        Cell(", ".join(_words(each, names) for each in found.largest)),
    )


def _words(found: LargeDispersion, names: Names) -> str:
    """'lift +8.1 % (1.6 sigma)'."""
    sigma = "" if found.sigma is None else f" ({fixed(found.sigma, 1)} sigma)"
    value = shown_value(found.parameter, found.value, names.campaign.parameters)
    return f"{spoken_name(found.parameter)} {value}{sigma}"


FLIGHTS = Topic(
    "flights", Flights, compute_flights, flight_section, flight_sentences, figures_of(__name__)
)
