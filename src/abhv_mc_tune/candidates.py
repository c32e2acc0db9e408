"""Candidates of tuning: a controller's file with other numbers, written with their units and ready to fly."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.tuning import Free
from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.law_file import NAMING_KEYS
from abhv_mc.flight.metrics import MARGIN_NAMES
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.interfaces import Engine
from abhv_mc.io.documents import Document, InputError, one_of, read_document, write_document
from abhv_mc.simulators.make_plans import declare
from abhv_mc.simulators.margin_plans import make_steady
from abhv_mc.stability.analysis import margins_of_flights
from abhv_mc.stability.fly_with_margins import add_margins

_NUMBER = re.compile(r"\s*(\+?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$")  # and its unit
Time = Literal["trim"] | float  # s


@dataclass(frozen=True)
class ControllerNumbers:
    """A controller's file with some of its numbers free. A point of the box -1 .. 1 holds logarithms of factors."""

    document: Document
    free: tuple[Free, ...]

    def factors(self, point: Floats) -> Floats:
        """Factors ``[free]`` that a point stands for."""
        return np.array([entry.factor for entry in self.free]) ** point

    def values(self, point: Floats) -> dict[str, str | float]:
        """The free entries as the file writes them."""
        factors = self.factors(point).tolist()
        entries = dict(_numbers(self.document.data))
        return {
            e.key: _scaled(entries[e.key], factor)
            for e, factor in zip(self.free, factors, strict=True)
        }

    def at_ends(self, point: Floats) -> list[str]:
        """Keys of the free numbers that a point puts on an end of their range."""
        return [
            entry.key
            for entry, x in zip(self.free, point.tolist(), strict=True)
            if abs(x) >= 1.0 - 1e-9
        ]

    def write(self, path: Path, point: Floats, comment: str = "") -> None:
        """Write the file with the free numbers of a point; the files of a user law stay the same."""
        data = dict(self.document.entries)
        for key in NAMING_KEYS:
            if key in data:
                named = data[key] if isinstance(data[key], list) else [data[key]]
                places = [(self.document.path.parent / text).resolve() for text in named]
                moved = [os.path.relpath(place, path.parent.resolve()) for place in places]
                data[key] = moved if isinstance(data[key], list) else moved[0]
        for key, value in self.values(point).items():
            data = _replaced(data, key.split("."), value)
        write_document(path, data, comment)


def read_controller_numbers(
    path: Path, free: Sequence[Free], block: Document, where: tuple[str | int, ...]
) -> ControllerNumbers:
    """Find the free numbers. Raises InputError, at its place in the ``tune`` block, for what the file does not have."""
    read_controller(path)
    document = read_document(path)
    numbers = dict(_numbers(document.data))
    for i, entry in enumerate(free):
        if entry.key not in numbers:
            expected = one_of(numbers, entry.key)
            found = f"'{entry.key}', which is no number above zero of {path.name}"
            raise block.error((*where, "free", i), found, expected)
    return ControllerNumbers(document, tuple(free))


def check_free_numbers(campaign: Experiment) -> None:
    """Raise InputError if no controller of a campaign has all free numbers of its block ``tune``.

    The error names those of the first controller, which is tuned by default.
    """
    block, document = campaign.model.tune, campaign.document
    if block is None:
        return
    first: InputError | None = None
    for path in campaign.model.controllers.values():
        try:
            read_controller_numbers(path, block.free, document, ("tune",))
        except InputError as error:
            first = first or error
        else:
            return
    if first is not None:
        raise first


def _numbers(data: Any, prefix: str = "") -> Any:
    """Keys and entries of all numbers above zero."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _numbers(value, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(data, int | float | str) and not isinstance(data, bool):
        match = _NUMBER.match(str(data))
        if match and float(match[1]) > 0.0:
            yield prefix, data


def _scaled(entry: Any, factor: float) -> str | float:
    """The entry times a factor, to six digits, with its unit."""
    match: Any = _NUMBER.match(str(entry))
    number, unit = match.groups()
    value = f"{float(number) * factor:.6g}"
    return f"{value} {unit}" if unit else float(value)


def _replaced(data: Any, keys: list[str], value: str | float) -> Any:
    if not keys:
        return value
    return {
        key: _replaced(inner, keys[1:], value) if key == keys[0] else inner
        for key, inner in data.items()
    }


@dataclass(frozen=True)
class Candidate:
    """A controller with its numbers: the plan of its flights."""

    plan: FlightPlan
    steady: FlightPlan | None  # of its steady flight, where there is one and margins are asked for

    def with_margins(self, times: Sequence[Time]) -> FlightPlan:
        """The plan with margins at these times; without where there is no steady flight."""
        return (
            self.plan if self.steady is None else add_margins(self.plan, self.steady, tuple(times))
        )

    def margins(self, vehicles: Floats, times: Sequence[Time]) -> Floats:
        """Least margins ``[vehicle, margin]`` of parameter rows; zero where there is no steady flight."""
        if self.steady is None:
            return np.zeros((len(vehicles), len(MARGIN_NAMES)))
        return margins_of_flights(self.plan, self.steady, vehicles, tuple(times)).table


@dataclass(frozen=True)
class Candidates:
    """Makes the candidates of one campaign's controller."""

    campaign: Experiment
    name: str  # of the controller
    numbers: ControllerNumbers
    engine: Engine

    def make(self, point: Floats, file: Path, steady: bool) -> Candidate | None:
        """The candidate of a point, written to ``file`` meanwhile; None where its numbers make no controller.

        Raises InputError where those of the start make none.
        """
        model = self.campaign.model
        try:
            self.numbers.write(file, point)
            plan = declare(
                self.campaign, self.engine.prepare(model.vehicle, model.mission, file, self.name)
            )
            try:
                return Candidate(plan, make_steady(self.campaign, plan, file) if steady else None)
            except (InputError, np.linalg.LinAlgError):
                return Candidate(plan, None)
        except InputError:
            if not np.any(point):
                raise
            return None
        finally:
            file.unlink(missing_ok=True)
