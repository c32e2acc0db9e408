"""``abhv-mc tune``: better numbers in a controller's file, shown to be better on fresh flights."""

import hashlib
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.campaign.file.check import CheckedCampaign, read_campaign
from abhv_mc.campaign.file.config import THREADS
from abhv_mc.campaign.file.resolve import resolve_campaign
from abhv_mc.campaign.file.tuning import Aim, Limit, Tune
from abhv_mc.campaign.run.executor import Executor, open_executor
from abhv_mc.campaign.run.progress import Progress
from abhv_mc.campaign.run.setup import Engine, make_engine
from abhv_mc.campaign.sampling.designs import INDEPENDENT, Design
from abhv_mc.campaign.sampling.samples import DrawnSamples, spread_parameters
from abhv_mc.campaign.search.controller_numbers import ControllerNumbers, read_controller_numbers
from abhv_mc.campaign.search.space import Space, make_space
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.signals import METRIC_INDEX
from abhv_mc.io.documents import Document, InputError, one_of, read_document, validate
from abhv_mc.search.evaluation import Floats
from abhv_mc.search.tune import Scores, Tuning, Validation, tune
from abhv_mc.search.tune import validate as validate_gain
from abhv_mc.statistics.estimates import sorted_quantile
from abhv_mc.store.folder import write_whole
from abhv_mc.store.lock import hold_lock

_BLOCK = 128  # flights of one call


@dataclass(frozen=True)
class TuneRequest:
    """What is tuned, and where the result goes."""

    campaign: Path
    out: Path  # the new controller file
    controller: str | None = None  # the campaign's first by default
    block: Path | None = None  # a file that holds the block ``tune``; the campaign's by default
    seed: int | None = None
    workers: int | None = None


@dataclass(frozen=True)
class Sides:
    """A metric's quantile over the fresh flights, of the start and of the result, and its limit."""

    metric: str
    quantile: float
    start: float
    best: float
    limit: float | None = None
    keeps: bool = True  # whether the result keeps the limit there, too


@dataclass(frozen=True)
class TuneFound:
    """What tuning found."""

    controller: str
    block: Tune
    numbers: ControllerNumbers
    tuning: Tuning
    validation: Validation
    sides: tuple[Sides, ...]  # the aim first, then the limits, then the usage

    @property
    def shown(self) -> bool:
        """Whether the result is shown to be better, within all limits."""
        return self.tuning.best != 0 and self.validation.better and all(side.keeps for side in self.sides)

    def as_json(self) -> dict[str, Any]:
        """The result as JSON holds it."""
        gain = self.validation.difference
        front = self.tuning.front
        return {
            "controller": self.controller,
            "metric": self.block.minimise.metric,
            "quantile": self.block.minimise.quantile,
            "shown_better": self.shown,
            "difference": {"value": gain.value, "low": gain.low, "high": gain.high},
            "fresh": [vars(side) for side in self.sides],
            "values": self.numbers.values(self.tuning.place),
            "at_bounds": self.numbers.at_ends(self.tuning.place),
            "candidates": len(self.tuning.points),
            "flights_each": self.block.flights,
            "validation_flights": self.block.validation,
            "front": [
                {"usage": float(self.tuning.scores.usage[i]), "objective": float(self.tuning.scores.objective[i])}
                | {"values": self.numbers.values(self.tuning.points[i])}
                for i in front.tolist()
            ],
        }


def read_tune_block(campaign: CheckedCampaign, path: Path | None) -> tuple[Tune, Document, tuple[str, ...]]:
    """The block, its document and its place there. Raises InputError."""
    where: tuple[str, ...] = ("tune",)
    document = campaign.document
    if path is None:
        if campaign.model.tune is None:
            raise document.error((), "no block 'tune'", "tune: {free: [...], minimise: {metric: ...}}, or --tune FILE")
        block = campaign.model.tune
    else:
        document = read_document(path)
        data = document.data
        if isinstance(data, dict) and set(data) == {"tune"} and isinstance(data["tune"], dict):
            nested = replace(
                document,
                data=data["tune"],
                value_places=_inner(document.value_places),
                key_places=_inner(document.key_places),
            )
            block = validate(nested, Tune)
        else:
            block, where = validate(document, Tune), ()
    for keys, metric in (
        (("minimise", "metric"), block.minimise.metric),
        (("usage", "metric"), block.usage.metric),
        *((("limits", i, "metric"), limit.metric) for i, limit in enumerate(block.limits)),
    ):
        if metric not in METRIC_INDEX:
            raise document.error((*where, *keys), f"metric '{metric}'", one_of(METRIC_INDEX, metric))
    return block, document, where


def _inner(places: Any) -> dict[Any, Any]:
    return {keys[1:]: place for keys, place in places.items() if keys[:1] == ("tune",)}


def tune_controller(request: TuneRequest, engine: Engine | None = None) -> TuneFound:
    """Search, validate on a fresh seed, and write the new file where the gain is shown.

    Every candidate's flights are kept beside the new file until it is written, so that the same command goes on after
    an interruption. Raises InputError for a request that is wrong.
    """
    engine = engine or make_engine()
    campaign = read_campaign(request.campaign, None, request.seed)
    model = campaign.model
    name = request.controller or next(iter(model.controllers))
    if name not in model.controllers:
        raise campaign.document.error(("controllers",), f"no controller '{name}'", one_of(model.controllers, name))
    block, document, where = read_tune_block(campaign, request.block)
    if request.out.exists():
        raise InputError(request.out, None, None, "a file that is there already", "a new file (-o NEW.yaml)")
    numbers = read_controller_numbers(model.controllers[name], block.free, document, where)
    space = make_space(campaign)
    # Threads: every candidate has a plan of its own, which worker processes would keep.
    execution = model.execution.model_copy(update={"isolation": THREADS})
    text = json.dumps([resolve_campaign(campaign).identity, name, block.model_dump(), model.seed, engine.source])
    kept = request.out.with_suffix(".tuning")
    with hold_lock(kept / ".lock"), open_executor(engine, execution, request.workers, None) as executor:
        study = _Study(
            campaign, name, space, numbers, kept, hashlib.sha256(text.encode()).hexdigest(), engine, executor
        )
        search = study.draw(model.seed, block.flights)
        with Progress("flights", block.candidates * block.flights) as progress:

            def measure(points: Floats) -> Scores:
                flown = study.fly(points, search)
                progress.add(len(points) * block.flights)
                return _score(flown, block, study.start_limits(block, search))

            found = tune(measure, np.zeros(len(block.free)), block.candidates, model.seed)
        result = _validate(study, block, found, name)
    if result.shown:
        write_whole(request.out, lambda aside: numbers.write(aside, found.place, _comment(result, request, model.seed)))
    return result


class _Study:
    """Flies candidates, and keeps what they flew."""

    def __init__(
        self,
        campaign: CheckedCampaign,
        name: str,
        space: Space,
        numbers: ControllerNumbers,
        kept: Path,
        identity: str,
        engine: Engine,
        executor: Executor,
    ) -> None:
        self.campaign, self.name, self.space, self.numbers = campaign, name, space, numbers
        self.kept, self.identity, self.engine, self.executor = kept, identity, engine, executor

    def draw(self, seed: int, flights: int) -> Floats:
        """Parameter rows ``[flight, parameter]`` that all candidates fly."""
        design = Design(INDEPENDENT, seed, self.space.names, flights, 2)
        values = DrawnSamples(design, self.space.marginals, self.space.copula).draw(0, flights)
        return spread_parameters(self.space.columns, self.space.complete(values, seed, 0))

    def fly(self, points: Floats, parameters: Floats) -> list[Floats]:
        """Metrics ``[flight, metric]`` of each candidate; not-a-number in the rows of flights that are lost."""
        different, places = np.unique(points, axis=0, return_inverse=True)
        with ThreadPoolExecutor(self.executor.workers) as threads:
            flown = list(threads.map(lambda point: self._one(point, parameters), different))
        return [flown[place] for place in places.reshape(-1).tolist()]

    def _one(self, point: Floats, parameters: Floats) -> Floats:
        key = hashlib.sha256(point.tobytes() + parameters.tobytes() + self.identity.encode()).hexdigest()[:32]
        path = self.kept / f"{key}.npy"
        if path.exists():
            return np.asarray(np.load(path, allow_pickle=False), np.float64)
        metrics = self._fly_new(point, parameters, key)

        def write(aside: Path) -> None:
            with aside.open("wb") as file:
                np.save(file, metrics, allow_pickle=False)

        write_whole(path, write)
        return metrics

    def _fly_new(self, point: Floats, parameters: Floats, key: str) -> Floats:
        plan = self._plan(point, key)
        if plan is None:
            return np.full((len(parameters), len(METRIC_INDEX)), np.nan)
        pieces = [
            self.executor.fly(plan, parameters[start : start + _BLOCK], None)
            for start in range(0, len(parameters), _BLOCK)
        ]
        metrics = np.concatenate([piece.metrics for piece in pieces])
        lost = np.concatenate([piece.outcome for piece in pieces]) != Outcome.OK
        return np.where(lost[:, None], np.nan, metrics)

    def _plan(self, point: Floats, key: str) -> FlightPlan | None:
        """The candidate's plan; None where its numbers make no controller."""
        file = self.kept / f"{key}.yaml"
        model = self.campaign.model
        try:
            self.numbers.write(file, point)
            return self.engine.prepare(model.vehicle, model.mission, file, self.name)
        except InputError:
            if not np.any(point):
                raise
            return None
        finally:
            file.unlink(missing_ok=True)

    def start_limits(self, block: Tune, parameters: Floats) -> list[float]:
        """The limits as numbers: those that are relative, times what the start has on these flights."""
        (start,) = self.fly(np.zeros((1, len(block.free))), parameters)
        return [_limit_of(limit, start) for limit in block.limits]


def _limit_of(limit: Limit, start: Floats) -> float:
    if limit.below_start_times is not None:
        return limit.below_start_times * _quantile(start, limit.metric, limit.quantile, 1.0)
    return float(limit.below if limit.below is not None else limit.above or 0.0)


def _quantile(metrics: Floats, metric: str, quantile: float, sign: float) -> float:
    """A quantile of a metric, lost flights being the worst: of its largest values, or its smallest for ``sign`` -1."""
    values = sign * metrics[:, METRIC_INDEX[metric]]
    return sign * sorted_quantile(np.sort(np.where(np.isnan(values), np.inf, values)), quantile)


def _score(flown: list[Floats], block: Tune, limits: list[float]) -> Scores:
    aim, usage = block.minimise, block.usage
    excess = [
        [_excess(metrics, entry, limit) for entry, limit in zip(block.limits, limits, strict=True)] for metrics in flown
    ]
    return Scores(
        np.array([_quantile(metrics, aim.metric, aim.quantile, 1.0) for metrics in flown]),
        np.array(excess).reshape(len(flown), len(limits)),
        np.array([_quantile(metrics, usage.metric, usage.quantile, 1.0) for metrics in flown]),
    )


def _excess(metrics: Floats, entry: Limit, limit: float) -> float:
    """How far a candidate is beyond a limit, relative to it."""
    sign = -1.0 if entry.above is not None else 1.0
    return sign * (_quantile(metrics, entry.metric, entry.quantile, sign) - limit) / (abs(limit) or 1.0)


def _validate(study: _Study, block: Tune, found: Tuning, name: str) -> TuneFound:
    """The result beside the start on flights of another seed."""
    fresh = study.draw((study.campaign.model.seed + 1) % 2**63, block.validation)
    start, best = study.fly(np.stack([np.zeros(len(block.free)), found.place]), fresh)
    aim = block.minimise
    column = METRIC_INDEX[aim.metric]
    worst: Callable[[Floats], Floats] = lambda values: np.where(np.isnan(values), np.inf, values)  # noqa: E731
    validation = validate_gain(worst(start[:, column]), worst(best[:, column]), aim.quantile)

    def side(entry: Aim | Limit, sign: float = 1.0, limit: float | None = None) -> Sides:
        at_start, at_best = (_quantile(m, entry.metric, entry.quantile, sign) for m in (start, best))
        keeps = limit is None or (isinstance(entry, Limit) and _excess(best, entry, limit) <= 0.0)
        return Sides(entry.metric, entry.quantile, at_start, at_best, limit, keeps)

    limits = [_limit_of(entry, start) for entry in block.limits]
    sides = [
        side(e, -1.0 if e.above is not None else 1.0, limit) for e, limit in zip(block.limits, limits, strict=True)
    ]
    known = [(aim.metric, aim.quantile), *((entry.metric, entry.quantile) for entry in block.limits)]
    usage = [] if (block.usage.metric, block.usage.quantile) in known else [side(block.usage)]
    return TuneFound(name, block, study.numbers, found, validation, (side(aim), *sides, *usage))


def _comment(found: TuneFound, request: TuneRequest, seed: int) -> str:
    """How the file was made, for its head."""
    aim, gain = found.sides[0], found.validation.difference
    percent = f"{100 * aim.quantile:g} % quantile of {aim.metric}"
    command = f"abhv-mc tune {request.campaign} --controller {found.controller} -o {request.out} --seed {seed}"
    command += f" --tune {request.block}" if request.block else ""
    lines = [
        f"Made by `{command}`:",
        f"{len(found.tuning.points)} candidates on {found.block.flights} flights each, the same for all.",
        f"On {found.block.validation} fresh flights the {percent} is {aim.best:.4g} instead of {aim.start:.4g}",
        f"(difference {gain.value:.4g}, 95 % interval {gain.low:.4g} .. {gain.high:.4g}).",
    ]
    for side in found.sides[1:]:
        bound = "" if side.limit is None else f", limit {side.limit:.4g}"
        lines.append(
            f"{side.metric}, {100 * side.quantile:g} % quantile: {side.best:.4g} instead of {side.start:.4g}{bound}."
        )
    return "\n".join(lines)
