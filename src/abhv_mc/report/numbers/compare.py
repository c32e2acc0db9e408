"""Two campaigns flown on the same samples, compared flight by flight."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.io.documents import InputError, Refusal, one_of
from abhv_mc.io.units import parse_in_unit
from abhv_mc.report.numbers.failures import requirement_words
from abhv_mc.report.numbers.flights import ControllerFlights, common_rows, distances
from abhv_mc.report.numbers.paired import pair_numbers
from abhv_mc.report.numbers.plain import plain
from abhv_mc.report.numbers.results import Results, read_results
from abhv_mc.statistics.paired import not_worse


def require_same_samples(a: Results, b: Results) -> None:
    """Raises InputError that names the first parameter and flight where the samples of two campaigns differ."""
    path = CampaignFolder(b.folder).samples
    wanted = f"the samples of {a.folder}"
    for name in a.samples:
        if name not in b.samples:
            raise InputError(path, None, None, f"no column '{name}'", wanted)
    for name in b.samples:
        if name not in a.samples:
            raise InputError(path, None, None, f"a column '{name}'", f"{wanted}, which have none")
    for name, mine in a.samples.items():
        theirs = b.samples[name]
        both = min(mine.size, theirs.size)
        differ = np.flatnonzero(mine[:both] != theirs[:both])
        if differ.size:
            k = int(differ[0])
            found = f"{name} = {float(theirs[k])!r} in flight {k}"
            raise InputError(path, None, None, found, f"{float(mine[k])!r} as in {a.folder}")


def parse_margins(texts: Sequence[str]) -> dict[str, float]:
    """``METRIC=5%`` as shares by metric. Raises InputError."""
    margins = {}
    for text in texts:
        metric, sign, value = text.partition("=")
        try:
            margin = parse_in_unit(value.strip(), "-") if sign else -1.0
        except Refusal:
            margin = -1.0
        if margin < 0.0:
            raise InputError("--fail-if-worse", None, None, f"'{text}'", "METRIC=SHARE, a share from 0 such as 5%")
        if metric.strip() in margins:
            raise InputError("--fail-if-worse", None, None, f"'{metric.strip()}' a second time", "each metric once")
        margins[metric.strip()] = margin
    return margins


def compare_folders(
    folder_a: Path, folder_b: Path, controllers: Sequence[str] = (), margins: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """Compare each controller that both campaigns flew: `a` is the first folder's.

    `controllers` names two to compare across, the first folder's and the second's. Where the numbers of flights
    differ, those that both flew are compared. `margins` are shares by which `b` may be worse in metrics.
    Raises InputError where the samples differ or nothing is in common.
    """
    a, b = read_results(folder_a), read_results(folder_b)
    require_same_samples(a, b)
    metrics = [name for name in a.metrics if name in b.metrics]
    compared = [name for name in a.compared if name in metrics]
    records = a.campaign.metrics
    for metric in margins or {}:
        if metric not in metrics:
            raise InputError("--fail-if-worse", None, None, f"unknown metric '{metric}'", one_of(metrics, metric))
    requirements = [item for item in a.campaign.requirements if item.metric in metrics]
    pairs = []
    for one, other in _pairs(a, b, controllers):
        names = (f"{folder_a}: {one}", f"{folder_b}: {other}")
        found = pair_numbers(
            a.flights[one],
            replace(b.flights[other], records=records),
            names,
            metrics,
            compared,
            requirements,
            independent=a.campaign.independent,
        )
        if found is not None:
            gates = {
                metric: _gate(a.flights[one], replace(b.flights[other], records=records), metric, m)
                for metric, m in (margins or {}).items()
            }
            pairs.append(found | {"not_worse": gates})
    if not pairs:
        raise InputError(folder_b, None, None, "no flight that both campaigns flew", f"flights of {folder_a}")
    for results in (a, b):
        results.refuse_changes()
    return {
        "requirements": [requirement_words(item, records) for item in requirements],
        "words": {name: records[name].as_words() for name in metrics},
        "paired": pairs,
    }


def _gate(a: ControllerFlights, b: ControllerFlights, metric: str, margin: float) -> dict[str, Any]:
    """Whether `b` is shown to be at most so much worse."""
    rows_a, rows_b = common_rows(a, b)
    values = distances(a, metric, rows_a), distances(b, metric, rows_b)
    found = not_worse(*values, a.failed[rows_a], b.failed[rows_b], margin)
    return {**plain(found), "shown": found.shown}


def _pairs(a: Results, b: Results, controllers: Sequence[str]) -> Iterator[tuple[str, str]]:
    if controllers:
        if len(controllers) != 2:
            found = f"{len(controllers)} controllers"
            raise InputError("--controllers", None, None, found, "two: the first folder's and the second's")
        for name, results in zip(controllers, (a, b), strict=True):
            if name not in results.flights:
                wanted = " or ".join(results.controllers)
                raise InputError(results.folder, None, None, f"no flights of '{name}'", wanted)
        yield controllers[0], controllers[1]
        return
    common = [name for name in a.controllers if name in b.flights]
    if not common:
        found = f"the controllers {', '.join(b.controllers)}"
        raise InputError(b.folder, None, None, found, f"one of {', '.join(a.controllers)}")
    yield from ((name, name) for name in common)
