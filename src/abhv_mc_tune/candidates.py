"""Candidates in a tuning run: plans of a controller with changed parameters."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.metrics import MARGIN_NAMES
from abhv_mc.interfaces import Engine
from abhv_mc.io.documents import Document, InputError, one_of, read_document, write_document
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.law_file import NAMING_KEYS
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.stability.analysis import margins_of_flights
from abhv_mc_vehicle.stability.fly_with_margins import add_margins
from abhv_mc_vehicle.vehicle_simulator.make_plans import declare
from abhv_mc_vehicle.vehicle_simulator.margin_plans import make_steady
from abhv_mc_vehicle.vehicle_simulator.tuning import Free

_NUMBER = re.compile(
    r"\s*(\+?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*$"
)  # number with its unit
Time = Literal["trim"] | float  # trim, or a time of the flight in s


@dataclass(frozen=True)
class ControllerNumbers:
    """Controller file with free parameters.

    A point has one coordinate from -1 to 1 for each free parameter: the logarithm of its factor to
    the base of its largest factor.
    """

    document: Document
    free: tuple[Free, ...]

    def factors(self, point: Floats) -> Floats:
        """Return the factors [parameter] for a point [parameter]."""
        return np.array([entry.factor for entry in self.free]) ** point

    def values(self, point: Floats) -> dict[str, str | float]:
        """Return the free parameters of a point as written in the file, by key."""
        factors = self.factors(point).tolist()
        entries = dict(_numbers(self.document.data))
        return {
            e.key: _scaled(entries[e.key], factor)
            for e, factor in zip(self.free, factors, strict=True)
        }

    def at_ends(self, point: Floats) -> list[str]:
        """Return the keys of the free parameters that are at a bound of their range."""
        return [
            entry.key
            for entry, x in zip(self.free, point.tolist(), strict=True)
            if abs(x) >= 1.0 - 1e-9
        ]

    def write(self, path: Path, point: Floats, comment: str = "") -> None:
        """Write the controller file with the free parameters of a point.

        Paths of the files of a custom law are adapted to the new folder.
        """
        data = dict(self.document.entries)
        for key in NAMING_KEYS:
            if key in data:
                names = data[key] if isinstance(data[key], list) else [data[key]]
                files = [(self.document.path.parent / name).resolve() for name in names]
                relative = [os.path.relpath(file, path.parent.resolve()) for file in files]
                data[key] = relative if isinstance(data[key], list) else relative[0]
        for key, value in self.values(point).items():
            data = _replaced(data, key.split("."), value)
        write_document(path, data, comment)


def read_controller_numbers(
    path: Path, free: Sequence[Free], block: Document, keys: tuple[str | int, ...]
) -> ControllerNumbers:
    """Read a controller file and find the free parameters.

    ``keys`` lead to the ``tune`` block in the document ``block``. Raise InputError,
    with the location of the entry in the block, if an entry names a parameter that the file does
    not have.
    """
    read_controller(path)
    document = read_document(path)
    numbers = dict(_numbers(document.data))
    for i, entry in enumerate(free):
        if entry.key not in numbers:
            problem = f"'{entry.key}' is not a positive number in {path.name}"
            raise block.error((*keys, "free", i), problem, one_of(numbers, entry.key))
    return ControllerNumbers(document, tuple(free))


def check_free_numbers(campaign: Experiment) -> None:
    """Raise InputError if no controller has all free parameters of the ``tune`` block.

    The error refers to the first controller, which is tuned by default.
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
    """Yield the keys and entries of all positive numbers."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _numbers(value, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(data, int | float | str) and not isinstance(data, bool):
        match = _NUMBER.match(str(data))
        if match and float(match[1]) > 0.0:
            yield prefix, data


def _scaled(entry: Any, factor: float) -> str | float:
    """Return an entry multiplied by a factor, with its unit and six significant digits."""
    match: Any = _NUMBER.match(str(entry))
    number, unit = match.groups()
    value = f"{float(number) * factor:.6g}"
    return f"{value} {unit}" if unit else float(value)


def _replaced(data: Any, keys: list[str], value: str | float) -> Any:
    """Return nested data with the value at ``keys`` replaced."""
    if not keys:
        return value
    return {
        key: _replaced(inner, keys[1:], value) if key == keys[0] else inner
        for key, inner in data.items()
    }


@dataclass(frozen=True)
class Candidate:
    """Plan of a controller with the parameters of a candidate."""

    plan: FlightPlan
    steady: FlightPlan | None  # plan of steady flight, if a trim exists and margins are required

    def with_margins(self, times: Sequence[Time]) -> FlightPlan:
        """Return the plan with margins at ``times``, or without margins if there is no trim."""
        return (
            self.plan if self.steady is None else add_margins(self.plan, self.steady, tuple(times))
        )

    def margins(self, vehicles: Floats, times: Sequence[Time]) -> Floats:
        """Return the smallest margins [vehicle, margin] for parameter rows ``vehicles``.

        Margins are zero if there is no trim.
        """
        if self.steady is None:
            return np.zeros((len(vehicles), len(MARGIN_NAMES)))
        return margins_of_flights(self.plan, self.steady, vehicles, tuple(times)).table


@dataclass(frozen=True)
class Candidates:
    """Factory of the candidates of one controller of a campaign."""

    campaign: Experiment
    name: str  # name of the controller
    numbers: ControllerNumbers
    engine: Engine

    def make(self, point: Floats, file: Path, steady: bool) -> Candidate | None:
        """Return the candidate of a point, or None if its parameters are invalid.

        The controller is written to ``file``, which is deleted before the method returns. Raise
        InputError if the initial parameters are invalid.
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
