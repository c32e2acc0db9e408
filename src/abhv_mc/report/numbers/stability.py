"""The report's section on stability: margins in steady flight and of the flights, as numbers, tables and sentences."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from abhv_mc.flight.metrics import GAIN_MARGIN, MARGIN_FAULTS, MARGIN_NAMES, PHASE_MARGIN
from abhv_mc.folder.controller_flights import ControllerFlights
from abhv_mc.folder.results import Results
from abhv_mc.report.numbers.failures import failed_anyhow
from abhv_mc.topics.labels import controller_label
from abhv_mc.topics.plain import plain
from abhv_mc.topics.words import count_of, fixed, percent

LISTED = 5  # flights of least margin
_LOOPS = {"equivalence_ratio": "throttle", "all": "all at once"}
_NONE = "none"


def stability_numbers(results: Results) -> dict[str, Any]:
    """Margins in steady flight as the campaign found them, and of its flights."""
    campaign = results.campaign
    flights = {
        name: _flight_numbers(results, results.flights[name])
        for name in results.controllers
        if campaign.margin_flights and MARGIN_NAMES[0] in results.flights[name].metrics
    }
    return {
        "steady": results.stability,
        "points": list(campaign.margin_points),
        "flights": {name: entry for name, entry in flights.items() if entry["flights"]},
    }


def _flight_numbers(results: Results, flights: ControllerFlights) -> dict[str, Any]:
    rows = np.flatnonzero(np.isfinite(flights.metrics[MARGIN_NAMES[0]]))
    values = {name: flights.metrics[name][rows] for name in MARGIN_NAMES}
    faults = {signal.name: flights.metrics[signal.name][rows] for signal in MARGIN_FAULTS}
    lost = failed_anyhow(flights, results.campaign.requirements)[rows]
    order = np.lexsort((flights.flight[rows], values[MARGIN_NAMES[0]]))[:LISTED]
    entry: dict[str, Any] = {
        "flights": int(rows.size),
        "unstable": int((faults[MARGIN_FAULTS[0].name] > 0).sum()),
        "at_limit": int((faults[MARGIN_FAULTS[1].name] > 0).sum()),
        "margins": {
            name: {
                "median": plain(float(np.median(each))) if rows.size else None,
                "least": plain(float(each.min())) if rows.size else None,
            }
            for name, each in values.items()
        },
        "least": [
            {
                "flight": int(flights.flight[rows[i]]),
                "failed": bool(lost[i]),
                **{name: plain(float(each[i])) for name, each in (values | faults).items()},
            }
            for i in order
        ],
    }
    if results.campaign.requirements and rows.size:
        low = values[MARGIN_NAMES[0]] < GAIN_MARGIN.customary
        entry["failed_below"] = [int((lost & low).sum()), int(low.sum())]
        entry["failed_above"] = [int((lost & ~low).sum()), int((~low).sum())]
    return entry


@dataclass(frozen=True)
class LeastMargins:
    """The least of all loops in steady flight; infinite where nothing bounds it."""

    stable: bool
    gain: float = np.inf  # dB
    gain_loop: str = ""
    phase: float = np.inf  # deg
    phase_loop: str = ""

    @property
    def little(self) -> bool:
        """Whether a margin is less than is customary."""
        return self.gain < GAIN_MARGIN.customary or self.phase < PHASE_MARGIN.customary


def least_margins(numbers: Mapping[str, Any], name: str) -> LeastMargins | None:
    """Of the nominal vehicle in steady flight; None where no margins were found."""
    entry = numbers["stability"]["steady"].get("controllers", {}).get(name)
    if entry is None or "fault" in entry:
        return None
    *loops, together = entry["nominal"]
    if not together["stable"]:
        return LeastMargins(stable=False)
    gain, loop = min((_gain(row), row["loop"]) for row in loops)
    phases = [(row["phase_margin_deg"], row["loop"]) for row in loops if row["phase_margin_deg"]]
    phase, which = min(phases, default=(np.inf, loop))
    return LeastMargins(True, gain, _loop(loop), phase, _loop(which))


def corners_unstable(numbers: Mapping[str, Any], name: str) -> tuple[int, int]:
    """At how many corners of the dispersions a controller that is stable without them is not, and of how many."""
    steady = numbers["stability"]["steady"]
    return steady.get("controllers", {}).get(name, {}).get("corners_unstable", 0), steady.get("corners", 0)


def stability_words(numbers: Mapping[str, Any], name: str) -> str:
    """What the first screen says of a controller's loops in steady flight; '' where nothing is known."""
    steady = numbers["stability"]["steady"]
    entry = steady.get("controllers", {}).get(name)
    if entry is None:
        return ""
    if "fault" in entry:
        return f"no margins in steady flight at the mission's start: {entry['fault']}"
    together = entry["nominal"][-1]
    if not together["stable"]:
        poles = ", ".join(_pole(*pole) for pole in together["poles"] if pole[0] > 0.0)
        return f"unstable in steady, level flight (poles at {poles} per second)"
    least = least_margins(numbers, name) or LeastMargins(stable=True)
    margins = f"{fixed(least.gain, 1)} dB ({least.gain_loop})" if np.isfinite(least.gain) else "no limit on the gain"
    margins += f" and {fixed(least.phase, 0)} deg ({least.phase_loop})" if np.isfinite(least.phase) else ""
    words = f"least margins in steady, level flight {margins}"
    if least.little:
        words = f"little margin in steady, level flight: {margins}, where 6 dB and 30 to 45 deg are customary"
    if entry["corners_unstable"]:
        tried = "corners" if steady.get("all_corners") else "corners, drawn at random,"
        words += f"; unstable at {entry['corners_unstable']} of {steady['corners']} {tried} of the dispersions"
    return words


def _pole(real: float, imaginary: float) -> str:
    return f"+{real:.3f}" + (f" \N{PLUS-MINUS SIGN} {imaginary:.2f}j" if imaginary else "")


def _gain(row: Mapping[str, Any]) -> float:
    """The smaller of both sides, dB."""
    sides = [
        abs(row[f"gain_margin_{side}_db"]) for side in ("low", "high") if row[f"gain_margin_{side}_db"] is not None
    ]
    return min(sides, default=np.inf)


def _loop(name: str) -> str:
    return _LOOPS.get(name, name)


def steady_tables(numbers: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A table for each controller: a row for each loop, nominal and least over the corners."""
    steady = numbers["stability"]["steady"]
    tables = []
    for name, entry in steady.get("controllers", {}).items():
        rows = []
        if entry.get("nominal") and entry["nominal"][-1]["stable"]:
            corners = {row["loop"]: row for row in entry["corners"]}
            rows = [_steady_row(row, corners.get(row["loop"], {})) for row in entry["nominal"]]
        tables.append(
            {
                "controller": controller_label(name),
                "rows": rows,
                "unstable": entry.get("corners_unstable", 0),
                "corners": steady["corners"],
            }
        )
    return tables


def _steady_row(row: Mapping[str, Any], corner: Mapping[str, Any]) -> dict[str, Any]:
    if row["loop"] == "all":
        cells = [_margin(each, "disk_gain_db", 1, "\N{PLUS-MINUS SIGN}") for each in (row, corner)]
        phases = [_margin(each, "disk_phase_deg", 0, "\N{PLUS-MINUS SIGN}") for each in (row, corner)]
    else:
        cells = [
            f"{_margin(each, 'gain_margin_low_db', 1)} / {_margin(each, 'gain_margin_high_db', 1)}"
            for each in (row, corner)
        ]
        phases = [_margin(each, "phase_margin_deg", 0) for each in (row, corner)]
    delays = [_margin(each, "delay_margin_ms", 0) for each in (row, corner)]
    return {"loop": _loop(row["loop"]), "gain": cells, "phase": phases, "delay": delays}


def _margin(row: Mapping[str, Any], key: str, digits: int, sign: str = "") -> str:
    value = row.get(key)
    return _NONE if value is None else f"{sign}{fixed(value, digits)}"


def flight_tables(numbers: Mapping[str, Any], folder: str) -> list[dict[str, Any]]:
    """For each controller the margins of its flights in words, and those of least margin."""
    tables = []
    for name, entry in numbers["stability"]["flights"].items():
        total = entry["flights"]
        ends = [
            f"{fixed(entry['margins'][key]['median'], digits)} / {fixed(entry['margins'][key]['least'], digits)}"
            for key, digits in zip(MARGIN_NAMES, (1, 0, 0, 2), strict=True)
        ]
        tables.append(
            {
                "controller": controller_label(name),
                "ends": ends,
                "unstable": count_of(entry["unstable"], total),
                "at_limit": count_of(entry["at_limit"], total),
                "failed": _failed_words(entry),
                "rows": [
                    {
                        "flight": row["flight"],
                        "values": [fixed(row[key], d) for key, d in zip(MARGIN_NAMES, (1, 0, 0, 2), strict=True)],
                        "failed": "yes" if row["failed"] else "no",
                        "command": f"abhv-mc replay {folder} --flight {row['flight']} --controller {name}",
                    }
                    for row in entry["least"]
                ],
            }
        )
    return tables


def _failed_words(entry: Mapping[str, Any]) -> str:
    """'3 of 40 (7.5 %) below 6 dB, 0 of 60 (0 %) from there on', empty without requirements."""
    if "failed_below" not in entry:
        return ""
    words = []
    for key, side in (("failed_below", "below 6 dB"), ("failed_above", "from 6 dB on")):
        failed, total = entry[key]
        if total:
            words.append(f"{count_of(failed, total)} ({percent(failed / total, 2)}) {side}")
    return ", ".join(words)


def points_in_words(numbers: Mapping[str, Any]) -> str:
    """'at the trim and at 30 s'."""
    return " and ".join(
        "in steady flight at the start" if point == "trim" else f"{point:g} s into the flight (reference frozen)"
        for point in numbers["stability"]["points"]
    )


def stability_context(numbers: Mapping[str, Any], folder: str) -> dict[str, Any]:
    """What the templates of the section need."""
    steady = numbers["stability"]["steady"]
    corners = f"{'all' if steady.get('all_corners') else 'random'} {steady.get('corners', 0)} corners"
    return {
        "steady": steady_tables(numbers),
        "corners": corners,
        "flights": flight_tables(numbers, folder),
        "points": points_in_words(numbers),
    }
