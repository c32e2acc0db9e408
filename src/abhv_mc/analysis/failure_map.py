"""Failure map of a campaign: groups of flights that fail with the same few dispersions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import TypeAdapter, ValidationError

from abhv_mc.analysis.explain import Failure, find_failure, smallest_sets, with_margins
from abhv_mc.analysis.replay import find_rows
from abhv_mc.analysis.shrink import Shrunk
from abhv_mc.array_types import Floats, Mask
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.executor import open_executor, open_flown
from abhv_mc.folder.layout import CampaignFolder, write_bytes
from abhv_mc.folder.manifest import read_manifest
from abhv_mc.interfaces import Engine, Fly
from abhv_mc.io.messages import InputError

MOST_CAUSES = 3  # maximum number of dispersions in an explanation; larger sets are not informative


class Cause(NamedTuple):
    """Set of inputs, with the signs of their deviations, that explains a group of failures."""

    inputs: tuple[int, ...]
    high: tuple[bool, ...]  # whether each input is above its nominal value
    failures: tuple[int, ...]


def group_failures(explanations: Sequence[Shrunk | None], high: Mask) -> list[Cause]:
    """Return the causes of failures, starting with the most frequent cause.

    Unexplained failures are omitted. `high` [failure, input] marks inputs above their nominal
    values, because deviations in opposite directions are different causes. A failure explained by
    several sets is assigned to the set that explains the most failures (greedy set cover), because
    the smallest set of one flight is often a borderline case of another cause.
    """
    sets = {
        failure: {
            tuple((i, bool(high[failure, i])) for i in members)
            for members in shrunk.sets
            if 0 < len(members) <= MOST_CAUSES
        }
        for failure, shrunk in enumerate(explanations)
        if shrunk is not None
    }
    left = {failure for failure, members in sets.items() if members}
    causes = []
    while left:
        explained: dict[tuple[tuple[int, bool], ...], list[int]] = {}
        for failure in sorted(left):
            for members in sets[failure]:
                explained.setdefault(members, []).append(failure)
        best = min(explained, key=lambda members: (-len(explained[members]), len(members), members))
        inputs, sides = zip(*best, strict=True)
        causes.append(Cause(inputs, sides, tuple(explained[best])))
        left -= set(explained[best])
    return causes


MOST_FLIGHTS = 50  # maximum number of analysed flights per controller
# maximum number of sets of dispersions tried per flight, smallest sets first (enough for all pairs
# of 27 dispersions)
_BUDGET = 400


@dataclass(frozen=True)
class Dispersed:
    """Dispersion that belongs to a failure cause, with the range of its values in SI units."""

    parameter: str
    high: bool  # whether the values in all flights are above nominal; otherwise all are below
    least: float
    median: float
    largest: float


@dataclass(frozen=True)
class FailureGroup:
    """Flights that fail in the same way due to the same set of dispersions."""

    failure: str  # description of the kind of failure
    dispersions: tuple[Dispersed, ...]
    flights: tuple[int, ...]  # flight numbers, most severe failure first


@dataclass(frozen=True)
class ControllerFailures:
    """Failure groups of one controller."""

    failed: int  # number of failed flights, including those not analysed
    groups: tuple[FailureGroup, ...]  # groups by kind of failure, largest first
    nominal: tuple[int, ...]  # flights that also fail with all dispersions at their nominal values
    unexplained: tuple[int, ...]  # failed flights that no small set explains
    tried: int  # number of flights simulated for the analysis

    @property
    def looked_at(self) -> int:
        """Number of analysed flights."""
        return (
            sum(len(group.flights) for group in self.groups)
            + len(self.nominal)
            + len(self.unexplained)
        )


@dataclass(frozen=True)
class FailureMap:
    """Failure map of a campaign, with the digest of the campaign's flights."""

    digest: str
    controllers: dict[str, ControllerFailures]


_ADAPTER = TypeAdapter(FailureMap)


def map_failures(
    root: Path,
    failed: Mapping[str, Sequence[int]],
    engine: Engine | None = None,
    trust_code: bool = False,
) -> FailureMap:
    """Explain the first MOST_FLIGHTS failures of each controller and group them by cause."""
    folder = CampaignFolder(root)
    campaign = open_flown(folder, failed, trust_code)
    with open_executor(
        engine or campaign.simulator.engine, campaign.model.execution, None
    ) as executor:
        controllers = {
            name: _map_controller(folder, campaign, name, flights, executor.fly_parallel)
            for name, flights in failed.items()
        }
    return FailureMap(str(read_manifest(folder.manifest).digest), controllers)


def _map_controller(
    folder: CampaignFolder, campaign: Experiment, controller: str, failed: Sequence[int], fly: Fly
) -> ControllerFailures:
    flights = [int(flight) for flight in failed[:MOST_FLIGHTS]]
    rows = find_rows(folder, controller, flights)
    failures = [find_failure(folder.root, campaign, row, None) for row in rows]
    names, nominal = campaign.dimensions, campaign.parameters.nominal_of(campaign.dimensions)
    if not rows:
        return ControllerFailures(0, (), (), (), 0)
    campaign, margins = with_margins(campaign, controller, failures)
    samples = np.concatenate([row.samples for row in rows])
    explanations = smallest_sets(
        folder, campaign, controller, samples, failures, fly=fly, margins=margins, budget=_BUDGET
    )
    values = samples[:, : len(names)]
    groups, grouped = _group(
        names, flights, failures, values, values > nominal, explanations=explanations
    )
    bare = tuple(
        flight
        for flight, explanation in zip(flights, explanations, strict=True)
        if explanation is not None and () in explanation.sets
    )
    return ControllerFailures(
        len(failed),
        groups,
        bare,
        tuple(flight for flight in flights if flight not in grouped and flight not in bare),
        sum(explanation.tried for explanation in explanations if explanation),
    )


def _group(
    names: Sequence[str],
    flights: Sequence[int],
    failures: Sequence[Failure],
    values: Floats,
    high: Mask,
    *,
    explanations: Sequence[Shrunk | None],
) -> tuple[tuple[FailureGroup, ...], set[int]]:
    """Group the failures of each kind by cause; return the groups and all grouped flights."""
    groups = []
    for description in dict.fromkeys(failure.words for failure in failures):
        members = [k for k, failure in enumerate(failures) if failure.words == description]
        for cause in group_failures([explanations[k] for k in members], high[members]):
            rows = [members[k] for k in cause.failures]
            low, middle, top = np.quantile(
                values[np.ix_(rows, cause.inputs)], (0.0, 0.5, 1.0), axis=0
            ).tolist()
            ends = zip(low, middle, top, strict=True)
            columns = zip((names[i] for i in cause.inputs), cause.high, ends, strict=True)
            dispersions = tuple(Dispersed(name, side, *three) for name, side, three in columns)
            groups.append(FailureGroup(description, dispersions, tuple(flights[k] for k in rows)))
    return tuple(groups), {flight for group in groups for flight in group.flights}


def write_map(root: Path, failure_map: FailureMap) -> Path:
    """Write the failure map into the campaign's folder; return its path."""
    path = CampaignFolder(root).failure_map
    path.parent.mkdir(exist_ok=True)
    write_bytes(path, _ADAPTER.dump_json(failure_map, indent=1) + b"\n")
    return path


def read_map(root: Path, digest: str | None) -> FailureMap | None:
    """Return the failure map stored in a folder.

    The result is None if the folder has no failure map, or one with another digest.
    """
    path = CampaignFolder(root).failure_map
    if not path.is_file():
        return None
    try:
        failure_map = _ADAPTER.validate_json(path.read_bytes())
    except ValidationError as error:
        expected = f"a file written by 'abhv-mc explain {root} --all'; repeat that command"
        raise InputError(path, str(error.errors()[0]["msg"]), expected) from None
    return failure_map if failure_map.digest == digest else None
