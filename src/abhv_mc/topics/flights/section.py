"""What was flown and how it ended, the linked view of the flights, and tables of the worst ones."""

from collections.abc import Iterator, Mapping
from typing import Any

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.topics.flights.model import FlightCounts, Flights
from abhv_mc.topics.flights.worst_flights import LargeDispersion, WorstFlight
from abhv_mc.topics.names import Names
from abhv_mc.topics.parameter_words import parameter_doc, shown_value, spoken_name
from abhv_mc.topics.section import Cell, Fold, Item, Picture, Row, Section, Table, Text, Widget
from abhv_mc.topics.words import fixed, joined, significant

_COLUMNS = 5  # metrics beside each of the worst flights


def flight_section(found: Flights, names: Names) -> Section:
    """All of it; the linked view stands on a page alone."""
    return Section("What each flight did", tuple(_items(found, names)))


def _items(found: Flights, names: Names) -> Iterator[Item]:
    if found.source:
        yield Text(_flown(found, found.source.campaign, names))
    if found.dispersions:
        rows = [_dispersion(name, _law(entry), _settings(entry), names) for name, entry in found.dispersions.items()]
        rows += [_dispersion(name, "derived", text, names) for name, text in found.derived.items()]
        yield Table("Dispersions", ("Parameter", "Meaning", "Distribution", "Settings"), (tuple(rows),), numbers=False)
    heads = (names.kind.capitalize(), "Flown", "Ended early", "Not computed", "Outcomes")
    counts = tuple(_counts(names.label(name), entry) for name, entry in found.counts.items())
    yield Table("How the flights ended", heads, (counts,), numbers=False)
    yield Widget("flights")
    drawn = found.source is None or found.source.campaign.has_histories
    words = (
        "Flights that ended early come first, the earliest before all others, then those furthest past (or nearest to) "
        "a limit, in units of it as in the chart (without requirements, of the median). "
        f"{'Their histories are kept: a number draws it above' if drawn else 'A number opens it above'}; on paper the "
        "first five are listed."
    )
    if names.flies:
        words += f" `abhv-mc explain {names.folder} --controller NAME --flight NUMBER` finds the smallest set of "
        words += "dispersions that still makes a flight fail."
    yield Text(words)
    asked = (names.metrics[metric].label_with_unit for metric in names.asked[:_COLUMNS])
    worst_heads = ("Flight", "Outcome", "Worst in", "Beyond its limit (units of it)", *asked, "Largest dispersions")
    for name, flights in found.worst.items():
        title = f"Worst flights of {names.label(name)}"
        again = f"Again, bit for bit: `abhv-mc replay {names.folder} --controller {name} --flight NUMBER`"
        table = Table(title, worst_heads, (tuple(_worst(name, each, names) for each in flights),))
        yield Fold(title, (Text(again), table) if names.flies else (table,))
    yield Picture("worst_flights")


def _flown(found: Flights, campaign: Experiment, names: Names) -> str:
    flown = fixed(next(iter(found.counts.values())).flown, 0)
    text = f"{joined(list(names.controllers.values()))} flew {'the same ' if len(names.controllers) > 1 else ''}{flown}"
    text += " dispersed flights"
    if campaign.stops_when_proven:
        text += f" (at most {fixed(campaign.runs, 0)}; it stops when proven)"
    seeds = f"seeds {', '.join(map(str, campaign.pooled_seeds))} one after the other"
    if campaign.adopted:
        independent = "are" if campaign.independent else "are not said to be"
        return f"{text}, adopted from a table; they {independent} independent draws. "
    text += f" ({campaign.sampling.replace('_', ' ')} sampling, "
    text += f"{seeds if campaign.pooled_seeds else f'seed {campaign.seed}'}). "
    if found.dispersions:
        count, unknowns = len(found.dispersions) - len(campaign.unknowns.names), campaign.unknowns
        if unknowns.names:
            text += f"Each sample flew at each of {len(unknowns.points)} values of the unknowns. "
        text += f"Each flight drew {count} parameter{'s' if count != 1 else ''} as listed here; nothing else differed "
        text += "from the nominal flight. "
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
    return Cell(f"`{name}`", head=True), Cell(parameter_doc(name, names.parameters)), Cell(law), Cell(settings)


def _counts(label: str, found: FlightCounts) -> Row:
    outcomes = joined([f"{count} {code.replace('_', ' ')}" for code, count in found.outcomes.items()])
    numbers = (fixed(count, 0) for count in (found.flown, found.failed, found.not_computed))
    return (Cell(label, head=True), *map(Cell, numbers), Cell(outcomes))


def _worst(controller: str, found: WorstFlight, names: Names) -> Row:
    values = (significant(found.metrics.get(metric), 6) for metric in names.asked[:_COLUMNS])
    return (
        Cell(str(found.flight), head=True, flight=(controller, found.flight)),
        Cell(found.outcome.replace("_", " ")),
        Cell(names.metrics[found.by].label if found.by else ""),
        Cell(significant(found.beyond, 3)),
        *map(Cell, values),
        Cell(", ".join(_words(each, names) for each in found.largest)),
    )


def _words(found: LargeDispersion, names: Names) -> str:
    """'lift +8.1 % (1.6 sigma)'."""
    sigma = "" if found.sigma is None else f" ({fixed(found.sigma, 1)} sigma)"
    return f"{spoken_name(found.parameter)} {shown_value(found.parameter, found.value, names.parameters)}{sigma}"
