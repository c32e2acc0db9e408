"""Unknowns: parameters that have one fixed value, of which only bounds are known."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.campaign.sampling.distributions import Value
from abhv_mc.flights.parameters import Parameter, Parameters
from abhv_mc.io.documents import Problems, StrictModel
from abhv_mc.io.messages import counted, grouped_digits, joined, one_of, quoted
from abhv_mc.statistics.unknowns import (
    MOST_UNKNOWNS,
    SEARCH_FLIGHTS,
    JudgedPoints,
    Search,
    showing_factor,
    standing_points,
)
from abhv_mc.statistics.verdicts import Verdict


class Unknown(StrictModel):
    """Bounds of an unknown parameter; a percentage is relative to the nominal value."""

    low: Value
    """lower bound: a value, or a change relative to the nominal value such as -10 %"""
    high: Value
    """upper bound, in the same form as 'low'"""


Count = Annotated[int, Field(ge=0)]


_HINTED = 3  # maximum number of dispersions named in a hint


def unknowns_hint(dispersed: Iterable[str]) -> str:
    """Return a hint about dispersed parameters that may have one true value, or ''."""
    drawn = [
        name for name in dispersed if name.startswith("aero.") or name.endswith("_effectiveness")
    ]
    if not drawn:
        return ""
    named = [f"'{name}'" for name in drawn[:_HINTED]]
    named += [f"{len(drawn) - _HINTED} more"] if len(drawn) > _HINTED else []
    return (
        f"New values of {joined(named)} are drawn for each flight. If a "
        "parameter has one value for the whole programme, list it under `unknowns`: requirements "
        "are then judged at its worst value."
    )


class MostFailures(StrictModel):
    """Point at which one controller failed a requirement most often during the search."""

    controller: str
    """controller for which the point was found"""
    requirement: Count
    """index of the requirement, from 0"""
    point: Count
    """index of the point, from 0"""
    failures: Count
    """number of failures at the point during the search"""
    flights: Count = SEARCH_FLIGHTS
    """number of flights simulated at each point tried"""
    tried: Count
    """number of points tried"""


class UnknownPoints(StrictModel):
    """Values of the unknowns at which requirements are judged, as found by `run`."""

    tried: Count = 0
    """number of points tried in the search"""
    shared: Count | None = None
    """number of points, counted from the first, at which all requirements are judged; default:
    all points. At every other point, a requirement is judged only if an entry of `most_failures`
    assigns that point to it"""
    most_failures: tuple[MostFailures, ...] = ()
    """for each controller and requirement, the point at which the requirement failed most often
    during the search"""
    requirements: tuple[dict[str, Any], ...] | None = None
    """requirements for which the points were searched; default: requirements of the campaign"""
    at: dict[str, tuple[float, ...]]
    """values of each unknown at the points, in SI units; each flight is simulated at every point"""


@dataclass(frozen=True)
class Unknowns:
    """Bounds of the unknowns, and the simulated points; without unknowns, one empty point."""

    names: tuple[str, ...] = ()
    low: Floats = field(default_factory=lambda: np.empty(0))  # lower bounds [unknown] in SI
    high: Floats = field(default_factory=lambda: np.empty(0))  # upper bounds [unknown] in SI
    points: Floats = field(default_factory=lambda: np.empty((1, 0)))  # [point, unknown] in SI
    tried: int = 0
    shared: int | None = None  # number of points at which all requirements are judged; None: all
    most_failures: tuple[MostFailures, ...] = ()
    # requirements for which the worst values of the unknowns were not searched
    unsearched: frozenset[int] = frozenset()
    parameters: Parameters = field(default_factory=lambda: Parameters(()))

    def values(self, positions: Floats) -> Floats:
        """Return SI values [point, unknown] for positions from -1 (lower bound) to 1 (upper)."""
        return self.low + 0.5 * (positions + 1.0) * (self.high - self.low)

    def words(self, point: int) -> str:
        """Return a description of a point, such as 'lift +10 %, drag -15 %'."""
        parts = []
        for name, value in zip(self.names, self.points[point].tolist(), strict=True):
            parameter = self.parameters[name]
            text = (
                f"{100.0 * (value - 1.0) + 0.0:+.3g} %"
                if parameter.is_factor
                else f"{value:.4g} {parameter.unit}"
            )
            parts.append(f"{(name.partition('.')[2] or name).replace('_', ' ')} {text}")
        return ", ".join(parts)

    def judged(self, requirement: int) -> list[int]:
        """Return the indices of the points at which a requirement is judged."""
        own = {entry.point for entry in self.most_failures if entry.requirement == requirement}
        shared = len(self.points) if self.shared is None else self.shared
        return sorted({*range(shared), *own})

    def note(
        self, controller: str, requirement: int, verdicts: Sequence[Verdict], worst: int
    ) -> str:
        """Return a note on the points at which a requirement is judged and on the search.

        ``verdicts`` [point] are the verdicts at all points; ``worst`` is the point farthest from a
        PASS.
        """
        number = len(self.judged(requirement))
        text = f"at each of {counted(number, 'value')} of the unknowns"
        if verdicts[worst].failures:
            text = (
                f"at the worst of {counted(number, 'value')} of the unknowns ({self.words(worst)})"
            )
        pair = controller, requirement
        for entry in self.most_failures:
            if (entry.controller, entry.requirement) == pair:
                return f"{text}; {self._most_words(entry, verdicts[entry.point])}"
        tried = f"; the search tried {counted(self.tried, 'value')}"
        return f"{text}{tried}" if self.tried else text

    def _most_words(self, entry: MostFailures, verdict: Verdict) -> str:
        tried, flights = counted(entry.tried, "value"), counted(entry.flights, "flight")
        point = self.words(entry.point)
        if entry.failures:
            text = (
                f"of the {tried} that the search tried, the one with the most failures "
                f"({grouped_digits(entry.failures)} in {flights}) is {point}"
            )
        else:
            text = (
                f"none of the {tried} that the search tried caused a failure in {flights}, and "
                f"the one nearest to the limit is {point}"
            )
        judged = counted(verdict.flights, "judged flight")
        text += f" ({grouped_digits(verdict.failures)} of {judged} failed there)"
        factor = showing_factor(verdict.probability, entry.flights)
        if factor <= 1.0:
            return text
        return (
            f"{text}; the search finds a value at which flights fail "
            f"{grouped_digits(float(f'{factor:.1g}'))} times too often in about half of the "
            "campaigns"
        )


def points_entry(
    unknowns: Unknowns,
    chosen: JudgedPoints,
    controllers: Sequence[str],
    searches: Sequence[Search],
    flights: int,
) -> dict[str, object]:
    """Return the entry `points` with the chosen points and the results of the searches.

    ``flights`` is the number of flights that each search simulates at a point.
    """
    values = unknowns.values(chosen.points)
    entry = {
        "tried": len(np.unique(np.vstack([search.points for search in searches]), axis=0))
        if searches
        else 0,
        "at": {name: values[:, i].tolist() for i, name in enumerate(unknowns.names)},
    }
    if searches:
        entry["shared"] = chosen.shared
        entry["most_failures"] = [
            {
                "controller": controllers[most.search],
                "requirement": most.requirement,
                "point": most.point,
                "failures": most.failures,
                **({} if flights == SEARCH_FLIGHTS else {"flights": flights}),
                "tried": len(searches[most.search].points),
            }
            for most in chosen.most_failures
        ]
    return entry


def match_requirements(
    unknowns: Unknowns,
    points: UnknownPoints | None,
    requirements: Sequence[Mapping[str, Any]],
) -> Unknowns:
    """Return the unknowns with the search results assigned to ``requirements``."""
    if points is None or points.requirements is None:
        return unknowns
    searched = [_severity(entry) for entry in points.requirements]
    numbers = [
        searched.index(key) if (key := _severity(entry)) in searched else None
        for entry in requirements
    ]
    return replace(
        unknowns,
        most_failures=tuple(
            entry.model_copy(update={"requirement": number})
            for number, old in enumerate(numbers)
            for entry in unknowns.most_failures
            if entry.requirement == old
        ),
        unsearched=frozenset(number for number, old in enumerate(numbers) if old is None),
    )


def _severity(entry: Mapping[str, Any]) -> tuple[object, ...]:
    """Return the entries of a requirement on which the search for the worst values depends."""
    keys = ("metric", "below", "above")
    return (*(str(entry.get(key)) for key in keys), entry.get("ended_early", "failure"))


def check_unknowns(
    unknowns: dict[str, Unknown],
    points: UnknownPoints | None,
    other_roles: dict[str, str],
    design: str,
    *,
    parameters: Parameters,
    errors: Problems,
) -> Unknowns:
    """Return the campaign's unknowns; append problems to ``errors``.

    ``other_roles`` maps parameters that have another role to its description, such as 'a
    dispersion'.
    """
    before, ends = len(errors), []
    for name, entry in unknowns.items():
        where = ("unknowns", name)
        if name not in parameters or parameters[name].seed:
            errors.add_key(
                where,
                f"unknown parameter '{name}'"
                if name not in parameters
                else f"'{name}' is a random seed",
                one_of(parameters.dispersible, name),
            )
        elif name in other_roles:
            errors.add_key(
                where,
                f"'{name}' is also {other_roles[name]}",
                "a parameter that is either drawn for each flight or unknown",
            )
        else:
            values = {(*where, key): getattr(entry, key) for key in ("low", "high")}
            ends.append(
                [_read(keys, value, parameters[name], errors) for keys, value in values.items()]
            )
            if not ends[-1][0] < ends[-1][1]:
                problem = f"the range from {ends[-1][0]:g} to {ends[-1][1]:g} is empty"
                errors.add((*where, "high"), problem, "'low' to be less than 'high'")
    if unknowns and design != INDEPENDENT:
        problem = f"the design '{design}' does not permit unknowns"
        errors.add_key(("unknowns",), problem, f"'sampling: {INDEPENDENT}'")
    if len(unknowns) > MOST_UNKNOWNS:
        errors.add_key(
            ("unknowns",), f"found {counted(len(unknowns), 'unknown')}", f"at most {MOST_UNKNOWNS}"
        )
    if points is not None:
        lengths = {len(values) for values in points.at.values()}
        if set(points.at) != set(unknowns) or len(lengths) != 1 or not min(lengths, default=0):
            expected = "the same number of values for each unknown, at least one"
            errors.add_key(("points",), f"'points' has values of {quoted(points.at)}", expected)
        number = min(lengths, default=0)
        if max([entry.point + 1 for entry in points.most_failures] + [points.shared or 0]) > number:
            errors.add_key(
                ("points",),
                "'shared' or 'most_failures' refers to more than the "
                f"{counted(number, 'point')} of 'at'",
                "indices of points, counted from 0",
            )
    if len(errors) > before or not unknowns:
        return Unknowns()
    low, high = np.array(ends).T
    box = Unknowns(tuple(unknowns), low, high, parameters=parameters)
    if points is None:
        return replace(box, points=box.values(standing_points(len(box.names))))
    return replace(
        box,
        points=np.column_stack([points.at[name] for name in box.names]),
        tried=points.tried,
        shared=points.shared,
        most_failures=points.most_failures,
    )


def _read(where: tuple[str, ...], value: Value, parameter: Parameter, errors: Problems) -> float:
    read = np.nan
    with errors.collect(*where):
        read = parameter.read(value, of_nominal=True)
    of_nominal = isinstance(value, str) and value.rstrip().endswith("%") and parameter.unit != "%"
    return read + (parameter.nominal if of_nominal else 0.0)
