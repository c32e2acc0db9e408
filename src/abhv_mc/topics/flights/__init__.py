"""Report section on the flights' outcomes, with an interactive view and the worst flights."""

from collections.abc import Iterator, Mapping
from typing import Any

from abhv_mc.campaign.file.unknowns import unknowns_hint
from abhv_mc.folder.flown_campaign import flights_with_history
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.messages import grouped_digits
from abhv_mc.topics.flights.model import (
    Flights,
    WorstFlight,
    compute_flights,
    ended_words,
)
from abhv_mc.topics.formatting import (
    count_of,
    fixed,
    parameter_doc,
    shown_value,
    significant,
    spoken_name,
)
from abhv_mc.topics.topic import (
    Cell,
    Fold,
    Item,
    Names,
    Picture,
    Records,
    Row,
    Section,
    Table,
    Text,
    Topic,
    Widget,
    figures_of,
    make_records,
    make_row,
)


def flight_section(flights: Flights, names: Names) -> Section:
    """Return the section on flights; the interactive view exists only on HTML pages."""
    return Section("Flights", tuple(_items(flights, names)))


def _items(flights_model: Flights, names: Names) -> Iterator[Item]:
    campaign = names.campaign
    yield _flown(flights_model, names)
    if flights_model.dispersions:
        laws = {name: (_law(x), _settings(x)) for name, x in flights_model.dispersions.items()}
        laws |= {name: ("derived", text) for name, text in flights_model.derived.items()}
        rows = tuple(
            make_row(f"`{name}`", parameter_doc(name, campaign.parameters), *texts)
            for name, texts in laws.items()
        )
        heads = ("Parameter", "Meaning", "Distribution", "Settings")
        yield Table("Dispersions", heads, (rows,), numbers=False)
    if flights_model.inputs:
        yield Table(
            "Mean and spread (standard deviation) of the inputs, as stated and as found in the "
            "table",
            ("Input", "Unit", "Stated mean", "Found mean", "Stated spread", "Found spread"),
            (
                tuple(
                    make_row(
                        f"`{name}`",
                        campaign.parameters[name].unit,
                        *(significant(x, 6) for x in (item.stated_mean, item.mean)),
                        *(significant(x, 4) for x in (item.stated_sigma, item.sigma)),
                    )
                    for name, item in flights_model.inputs.items()
                ),
            ),
        )
    if any(entry.failed or entry.not_computed for entry in flights_model.counts.values()):
        columns = (names.kind, "Flights", "Terminated early", "Not computed", "Outcomes")
        group = tuple(
            make_row(
                names.label(name),
                *map(grouped_digits, (x.flown, x.failed, x.not_computed)),
                ", ".join(f"{n} {code.replace('_', ' ')}" for code, n in x.outcomes.items()),
            )
            for name, x in flights_model.counts.items()
        )
        yield Table("Outcomes of the flights", columns, (group,), numbers=False)
    else:
        yield Text("No flight terminated early.")
    yield from _findings(flights_model, names)
    yield Widget("flights")
    explanation = (
        "The worst flights are sorted by severity: early terminations first (earliest on top), "
        "then by the exceedance of a limit in percent of the limit (of the median if there are no "
        "requirements), which is negative within the limit. The printed page lists the first five "
        f"of each {campaign.kind}."
    )
    if campaign.can_rerun:
        explanation += (
            f" `abhv-mc explain {names.folder} --controller NAME --flight NUMBER` finds the "
            "smallest set of dispersions that still makes a flight fail."
        )
    yield Text(explanation)
    worst_heads = (
        "Flight",
        "Outcome",
        "Worst in",
        f"Exceedance (% of {'limit' if any(c.limits for c in campaign.criteria) else 'median'})",
        *(names.metrics[metric].label_with_unit for metric in names.asked),
        "Largest dispersions",
    )
    for name, flights in flights_model.worst.items():
        title = f"Worst flights of {names.label(name)}"
        command = f"abhv-mc replay {names.folder} --controller {name} --flight NUMBER"
        rerun = Text(f"Re-run a flight, bit for bit, with `{command}`")
        listed = tuple(_worst(name, flight, names) for flight in flights)
        table = Table(title, worst_heads, (listed,)).without_constant()
        yield Fold(title, (*[rerun] * campaign.can_rerun, table))
    yield Picture("worst_flights")
    for path in CampaignFolder(names.results.folder).replayed_files():
        yield Picture(f"replayed_{path.stem}")
    if campaign.contents.zones:
        yield Picture("ground_tracks")


def _findings(flights_model: Flights, names: Names) -> Iterator[Table]:
    """Yield the table of flights that saturated, oscillated or left table ranges, if any."""
    findings = flights_model.findings
    channels = sorted({channel for entry in findings.values() for channel in entry.cycling})
    counts = {
        name: (
            entry.saturated or 0,
            *(entry.cycling.get(channel, 0) for channel in channels),
            entry.outside_tables or 0,
        )
        for name, entry in findings.items()
    }
    if not any(map(any, counts.values())):
        return
    heads = (
        names.kind,
        "Surface saturation",
        *(f"Oscillation, {channel.replace('_', ' ')}" for channel in channels),
        "Beyond the vehicle's tables",
    )
    rows = tuple(
        make_row(
            names.label(name), *(count_of(n, findings[name].flown) if n else "0" for n in numbers)
        )
        for name, numbers in counts.items()
    )
    ripple = max(entry.ripple_deg for entry in findings.values())
    caption = f"Flights with findings; an oscillation exceeds {ripple:g} deg from peak to peak"
    yield Table("Findings", heads, (rows,), caption)


def _kept(names: Names) -> str:
    """Return how many worst flights by changed requirements have histories, if not all."""
    results, number = names.results, names.campaign.worst
    if not (results.requirement_changes and number and names.campaign.channels):
        return ""
    worst = {
        name: {*results.flights[name].flight[results.ranking.rows_of(name)[:number]].tolist()}
        for name in results.controllers
    }
    kept = sum(len(flights_with_history(results.folder, name) & worst[name]) for name in worst)
    total = sum(map(len, worst.values()))
    if kept == total:
        return ""
    return f"{count_of(kept, total)} worst flights by these limits; `abhv-mc run` stores the others"


def _flown(flights: Flights, names: Names) -> Records:
    """Return how many flights were drawn, and how."""
    campaign = names.campaign
    unknowns, seeds = campaign.unknowns, campaign.pooled_seeds or [campaign.seed]
    flown = grouped_digits(next(iter(flights.counts.values())).flown)
    most = f" of at most {grouped_digits(campaign.runs)}, until every verdict is PASS or FAIL"
    claim = "not contradicted by any test" if campaign.independent else "not assumed"
    origin, dispersed = campaign.simulator.origin, [*flights.dispersions]
    return make_records(
        [
            ("Flights of each", f"{flown}{most if campaign.model.stop else ''}"),
            ("Samples", "" if origin else campaign.sampling.replace("_", " ")),
            ("Seed", "" if origin else ", ".join(map(str, seeds))),
            ("Imported from", origin),
            ("Independent draws", claim if origin else ""),
            ("Values of the unknowns", f"{len(unknowns.points)}" if unknowns.names else ""),
            ("Early termination", "a failure, unless `ended_early: as_measured`"),
            ("Histories", _kept(names)),
            ("Unknowns", unknowns_hint(name for name in dispersed if name not in unknowns.names)),
        ]
    )


def _law(entry: Mapping[str, Any]) -> str:
    return str(entry.get("distribution", "")).replace("_", " ")


def _settings(entry: Mapping[str, Any]) -> str:
    # The parts are the components of a mixture distribution.
    texts = [f"{_law(component)} ({_settings(component)})" for component in entry.get("parts", ())]
    texts += [
        f"{key.replace('_', ' ')} {value}"
        for key, value in entry.items()
        if key not in ("distribution", "parts")
    ]
    return ", ".join(texts)


def _worst(controller: str, flight: WorstFlight, names: Names) -> Row:
    parameters = names.campaign.parameters
    largest = (
        f"{spoken_name(item.parameter)} {shown_value(item.parameter, item.value, parameters)}"
        + ("" if item.sigma is None else f" ({fixed(item.sigma, 1)} sigma)")
        for item in flight.largest
    )
    texts = (
        ended_words(flight.outcome, flight.missed, len(names.requirements)),
        names.metrics[flight.by].label if flight.by else "",
        significant(100.0 * flight.beyond, 3),
        *(significant(flight.metrics.get(metric), 4) for metric in names.asked),
        ", ".join(largest),
    )
    head = Cell(str(flight.flight), head=True, flight=(controller, flight.flight))
    return (head, *map(Cell, texts))


FLIGHTS = Topic("flights", Flights, compute_flights, flight_section, figures_of(__name__))
