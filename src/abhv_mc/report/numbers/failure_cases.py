"""Which failures each controller survives: flights by what failed in them, with the time since the failure as an axis.

A flight's case is what was drawn to fail before the mission's end, so that every controller has the same flights in
each. An unstart by the vehicle's own condition belongs to no case: it depends on the controller.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.flight.failure_case import NO_FAILURE, failure_cases, failure_times
from abhv_mc.flight.metrics import MARGIN_FAULTS, MARGIN_NAMES
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.results import Results, read_histories
from abhv_mc.plant.parameters import FAILURE_TIMES
from abhv_mc.report.figures.channels import off_reference
from abhv_mc.report.figures.failure_cases import CaseBand, CasePanel, plot_bands, plot_survival
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import Interval
from abhv_mc.statistics.judgement import Pair, judge_pairs
from abhv_mc.topics.failed_flights import requirement_failures, requirement_words
from abhv_mc.topics.labels import controller_label
from abhv_mc.topics.plain import plain
from abhv_mc.topics.section import FigureText
from abhv_mc.topics.words import count_of, percent

_MOST_CASES = 8  # in figures, the most frequent
_FEWEST_KEPT = 5  # histories of a case that make a band
_CHANNELS = (
    ("altitude_m", "altitude error (m)", "altitude_reference_m"),
    ("angle_of_attack_deg", "angle of attack (deg)", ""),
    ("bank_deg", "bank (deg)", ""),
    ("sideslip_deg", "sideslip (deg)", ""),
)


def drawn_cases(results: Results) -> tuple[NDArray[np.str_], Floats]:
    """Case and time of the first failure (s, infinite without one) of every flight [flight] in the samples."""
    names = [name for name in results.samples if name in FAILURE_TIMES]
    columns = [results.samples[name] for name in names]
    if not columns:
        return np.empty(0, dtype=np.str_), np.empty(0)
    samples, end = np.column_stack(columns), float(results.reference["time"][-1])
    nothing = np.zeros(len(samples))
    first = failure_times(names, samples)
    return np.array(failure_cases(names, samples, nothing + end, nothing)), np.where(first < end, first, np.inf)


def _by_frequency(cases: NDArray[np.str_]) -> list[str]:
    names, counts = np.unique(cases, return_counts=True)
    order = sorted(zip(names.tolist(), counts.tolist(), strict=True), key=lambda pair: (-pair[1], pair[0]))
    return [name for name, _ in sorted(order, key=lambda pair: pair[0] != NO_FAILURE)]


def failure_case_numbers(results: Results) -> dict[str, Any]:
    """Survivors and verdicts of each case and controller; empty where no failure is dispersed."""
    cases, first = drawn_cases(results)
    if not cases.size:
        return {}
    campaign = results.campaign
    rows = []
    for case in _by_frequency(cases):
        entry: dict[str, Any] = {"case": case, "flights": int(np.sum(cases == case)), "controllers": {}}
        for name in results.controllers:
            flights = results.flights[name]
            inside = cases[flights.flight] == case
            lost, ends = flights.failed & inside, flights.end_time
            number, failures = int(inside.sum()), int(lost.sum())
            if not number:
                continue
            bounds = clopper_pearson(failures, number) if campaign.independent else (np.nan, np.nan)
            after = ends[lost] - first[flights.flight[lost]]
            cell = {
                "flights": number,
                "lost": failures,
                "lost_before": int(np.sum(after < 0.0)) if case != NO_FAILURE else 0,
                "survived": plain(Interval(1.0 - failures / number, 1.0 - bounds[1], 1.0 - bounds[0])),
                "median_time_to_loss_s": _median(after[after >= 0.0]) if case != NO_FAILURE else None,
                "requirements": {},
                "margins": _margins(flights, inside),
            }
            for item in campaign.requirements:
                if name in item.controllers:
                    missed = int(np.sum(requirement_failures(flights, item) & inside))
                    pair = Pair(missed, number, 0, item.probability, item.consumer_risk, item.producer_risk)
                    verdict = judge_pairs([pair], campaign.independent)[0]
                    words = requirement_words(item, campaign.metrics)
                    cell["requirements"][words] = {"missed": missed, "status": verdict.status}
            entry["controllers"][name] = cell
        rows.append(entry)
    return {"cases": rows, "end_s": float(results.reference["time"][-1])}


def _margins(flights: ControllerFlights, inside: NDArray[np.bool_]) -> dict[str, Any] | None:
    """Least gain margins of a case's flights, where they were asked for."""
    values = flights.metrics.get(MARGIN_NAMES[0], np.empty(0))
    known = inside & np.isfinite(values) if values.size else np.zeros(0, bool)
    if not known.any():
        return None
    unstable = flights.metrics[MARGIN_FAULTS[0].name][known] > 0
    return {"flights": int(known.sum()), "unstable": int(unstable.sum()), "median_db": float(np.median(values[known]))}


def _median(times: Floats) -> float | None:
    return float(np.median(times)) if times.size else None


def failure_case_rows(numbers: dict[str, Any]) -> list[dict[str, Any]]:
    """The table's rows in words."""
    rows = []
    for entry in numbers.get("cases", []):
        cells = []
        for name, cell in entry["controllers"].items():
            low, high = cell["survived"]["low"], cell["survived"]["high"]
            cells.append(
                {
                    "controller": controller_label(name),
                    "survived": percent(cell["survived"]["value"], 1),
                    "bounds": "" if low is None else f"{percent(low, 1)} to {percent(high, 1)}",
                    "lost": cell["lost"],
                    "time": "" if cell["median_time_to_loss_s"] is None else f"{cell['median_time_to_loss_s']:.1f} s",
                    "verdicts": [
                        f"{words}: missed by {found['missed']}, {found['status'].replace('_', ' ')}"
                        for words, found in cell["requirements"].items()
                    ]
                    + _margin_words(cell.get("margins")),
                }
            )
        rows.append({"case": entry["case"], "flights": entry["flights"], "cells": cells})
    return rows


def _margin_words(margins: dict[str, Any] | None) -> list[str]:
    if margins is None:
        return []
    unstable = count_of(margins["unstable"], margins["flights"])
    return [f"least gain margin {margins['median_db']:.1f} dB in the median, unstable at a point {unstable}"]


def failure_case_sentence(numbers: dict[str, Any], labels: Mapping[str, str]) -> str:
    """How many flights of each controller survived each single failure; '' where none came alone."""
    found = []
    for entry in numbers.get("cases", []):
        if entry["case"] == NO_FAILURE or " + " in entry["case"]:
            continue
        words = [
            f"{labels[name]} {count_of(cell['flights'] - cell['lost'], cell['flights'])}"
            for name, cell in entry["controllers"].items()
        ]
        found.append(f"{entry['case']}: {', '.join(words)}")
    return f"Flights that survived one failure alone: {'; '.join(found)}." if found else ""


def still_flying(after: Floats, lost: NDArray[np.bool_], times: Floats) -> Floats:
    """Share of flights still flying at ``times`` after their failure (Kaplan and Meier, JASA 53, 1958).

    after: time from failure to the flight's end, s, [flight]; lost: whether it was lost then, or its mission was over.
    """
    share, result, order = 1.0, np.empty(times.size), np.sort(np.unique(after[lost]))
    steps = []
    for moment in order:
        share *= 1.0 - np.sum(lost & (after == moment)) / np.sum(after >= moment)
        steps.append(share)
    place = np.searchsorted(order, times, side="right")
    levels = np.array([1.0, *steps])
    result[:] = levels[place]
    return np.where((times <= after.max(initial=0.0)) | (result == 0.0), result, np.nan)


def failure_case_figures(
    results: Results, labels: dict[str, str], colors: dict[str, str]
) -> Iterator[tuple[FigureText, Any]]:
    """Survival and bands of each case over the time since its first failure."""
    cases, first = drawn_cases(results)
    shown = [case for case in _by_frequency(cases) if case != NO_FAILURE][:_MOST_CASES] if cases.size else []
    if not shown:
        return
    longest = float(results.reference["time"][-1])
    times = np.linspace(0.0, longest, 400)
    panels = []
    for case in shown:
        curves = {}
        for name in results.controllers:
            flights = results.flights[name]
            after = flights.end_time - first[flights.flight]
            inside = (cases[flights.flight] == case) & (after >= 0.0)
            if inside.any():
                curves[name] = still_flying(after[inside], flights.failed[inside], times)
        panels.append(CasePanel(f"{case} ({int(np.sum(cases == case))} flights)", curves))
    text = FigureText(
        "failure_survival",
        "Who still flies after a failure",
        "Share of the flights of each case that still fly at a time after their first failure; flights whose mission "
        "is over by then no longer count (Kaplan and Meier's estimate). Where two failures were drawn, the second "
        "comes later.",
    )
    yield text, plot_survival(times, panels, labels, colors)
    yield from _bands(results, shown, (cases, first), labels, colors)


def _bands(
    results: Results,
    shown: list[str],
    drawn: tuple[NDArray[np.str_], Floats],
    labels: dict[str, str],
    colors: dict[str, str],
) -> Iterator[tuple[FigureText, Any]]:
    """Median and extremes of the kept histories about their first failure."""
    cases, first = drawn
    kept = {name: read_histories(results.folder, name) for name in results.controllers}
    grid = np.arange(-2.0, 20.0, 0.25)
    rows: list[list[CaseBand]] = []
    single = [case for case in shown if " + " not in case][:4]
    clock = results.reference["time"]
    for channel, label, given in _CHANNELS:
        row, less = [], results.reference[given] if given else None
        for case in single:
            bands = {}
            for name in results.controllers:
                held = [
                    np.interp(
                        grid,
                        h["time"] - first[k],
                        off_reference(h["time"], h[channel], clock, less),
                        left=np.nan,
                        right=np.nan,
                    )
                    for k, h in kept[name].items()
                    if channel in h and cases[k] == case
                ]
                if len(held) >= _FEWEST_KEPT:
                    bands[name] = _extremes(np.array(held))
            row.append(CaseBand(case, label, bands))
        rows.append(row)
    if any(band.bands for row in rows for band in row):
        text = FigureText(
            "failure_bands",
            "The flight after a failure",
            "Median (line) and smallest to largest value (band) of the flights whose histories were kept, against the "
            "time since the failure; a flight that was lost leaves the band at its end.",
        )
        yield text, plot_bands(grid, rows, labels, colors)


def _extremes(values: Floats) -> Floats:
    """Smallest, median and largest [3, time] of [flight, time] that may end."""
    result = np.full((3, values.shape[1]), np.nan)
    there = np.isfinite(values).any(axis=0)
    result[:, there] = np.nanmin(values[:, there], 0), np.nanmedian(values[:, there], 0), np.nanmax(values[:, there], 0)
    return result
