"""``abhv-mc tune``: better numbers in a controller's file, shown to be better on fresh flights."""

import hashlib
import json
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.config import THREADS
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.tuning import Aim, Limit, Tune
from abhv_mc.execution.executor import connect, open_executor
from abhv_mc.execution.progress import Progress
from abhv_mc.flight.metrics import MARGIN_NAMES, Metric
from abhv_mc.folder.inputs import collect_inputs
from abhv_mc.folder.layout import write_whole
from abhv_mc.folder.lock import hold_lock
from abhv_mc.interfaces import Engine
from abhv_mc.io.documents import Document, InputError, StrictModel, read_document, validate
from abhv_mc.io.input_files import reading_once
from abhv_mc.requests import Paths
from abhv_mc.search.search_flights import find_metric, read_searched
from abhv_mc.search.space import make_space
from abhv_mc.simulators.vehicle_simulator import make_engine
from abhv_mc.statistics.estimates import Interval
from abhv_mc.statistics.quantile_pairs import quantile_difference
from abhv_mc_tune.candidates import Candidates, ControllerNumbers, read_controller_numbers
from abhv_mc_tune.method import Scores, Tuning, tune
from abhv_mc_tune.request import TuneRequest
from abhv_mc_tune.trials import (
    Trials,
    bound_of,
    excess_of,
    limited_value,
    score,
    severities_of,
    value_of,
    vehicles_of,
)

# Endings of the folder of candidates, of the page, and of the file of a rejected candidate.
_KEPT, _PAGE, _REJECTED = ".tuning", ".html", ".rejected.yaml"


@dataclass(frozen=True)
class Sides:
    """A metric's quantile over the fresh flights, or a stability margin, of the start and the result, and its limit."""

    metric: str
    quantile: float | None  # of the metric over the flights; None for a stability margin
    vehicles: str | None  # whose stability margin; None for a metric of flights
    start: float
    best: float
    limit: float | None = None
    keeps: bool = True  # whether the result keeps the limit there, too
    floor: bool = False  # whether the limit is to be kept above
    band: Bounds | None = (
        None  # two limits of a requirement: the numbers are distances outside them
    )

    @property
    def words(self) -> str:
        """What it is: 'altitude_error_rms_m, 95 % quantile', 'gain_margin_min_db, corners'."""
        if self.quantile is None:
            return f"{self.metric}, {'nominal and corners' if self.vehicles == 'corners' else 'nominal'}"
        outside = f", distance outside the band {self.band}" if self.band else ""
        return f"{self.metric}{outside}, {100 * self.quantile:g} % quantile"


@dataclass(frozen=True)
class TuneFound:
    """What tuning found."""

    controller: str
    block: Tune
    numbers: ControllerNumbers
    tuning: Tuning
    validation: (
        Interval  # of the aim's quantile on fresh flights, result minus start: below zero is better
    )
    sides: tuple[
        Sides, ...
    ]  # the aim first, then the limits, the usage, and the nominal vehicle's margins
    metrics: Mapping[str, Metric]

    @property
    def aim(self) -> Metric:
        """What is made better."""
        return self.metrics[self.block.minimise.metric]

    @property
    def difference(self) -> Interval:
        """The result's quantile minus the start's, in the metric's unit."""
        return self.validation.in_sense(self.aim.bad)

    @property
    def shown(self) -> bool:
        """Whether the result is shown to be better, within all limits."""
        return (
            self.tuning.best != 0
            and self.validation.high < 0.0
            and all(side.keeps for side in self.sides)
        )

    def as_json(self) -> dict[str, Any]:
        """The result as JSON holds it."""
        gain = self.difference
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
                {
                    "usage": float(self.tuning.scores.usage[i]),
                    "objective": float(self.tuning.scores.objective[i]),
                }
                | {"values": self.numbers.values(self.tuning.points[i])}
                for i in front.tolist()
            ],
        }


class _TuneFile(StrictModel):
    tune: Tune


def read_tune_block(
    campaign: Experiment, path: Paths | None
) -> tuple[Tune, Document, tuple[str, ...]]:
    """The block, its document and its place there. Raises InputError."""
    where: tuple[str, ...] = ("tune",)
    document = campaign.document
    if path is None:
        if campaign.model.tune is None:
            raise document.error(
                (),
                "no block 'tune'",
                "tune: {free: [...], minimise: {metric: ...}}, or --tune FILE",
            )
        block = campaign.model.tune
    else:
        document = read_document(path)
        if isinstance(document.data, dict) and set(document.data) == {"tune"}:
            block = validate(document, _TuneFile).tune
        else:
            block, where = validate(document, Tune), ()
    for keys, metric in (
        (("minimise", "metric"), block.minimise.metric),
        (("usage", "metric"), block.usage.metric),
        *(
            (("limits", i, "metric"), limit.metric)
            for i, limit in enumerate(block.limits)
            if not limit.is_margin
        ),
    ):
        find_metric(campaign, metric, partial(document.error, (*where, *keys)))
    return block, document, where


def _check_margins(
    block: Tune, document: Document, where: tuple[str, ...], duration: float
) -> None:
    """Raise InputError for points outside the mission."""
    for i, time in enumerate(block.margins_at):
        if time != "trim" and not 0.0 <= time <= duration:
            expected = f"trim, or a time of the mission, 0 to {duration:g} s"
            raise document.error((*where, "margins_at", i), f"{time:g} s", expected)


def tune_controller(request: TuneRequest, engine: Engine | None = None) -> TuneFound:
    """Search, validate on a fresh seed, and write the new file where the gain is shown.

    Every candidate's flights are kept beside the new file, so that the same command goes on after an interruption. A
    candidate that is not shown to be better is written to :func:`rejected_file`. Raises InputError for a request that
    is wrong.
    """
    with reading_once():
        return _tune(request, engine or make_engine())


def _tune(request: TuneRequest, engine: Engine) -> TuneFound:
    campaign, name = read_searched(request.campaign, request.controller, request.seed, engine)
    model, out = campaign.model, Path(request.output)
    campaign.simulator.check("tuning")
    block, document, where = read_tune_block(campaign, request.block)
    if out.suffix in (_KEPT, _PAGE):
        words = f"the ending '{out.suffix}' of what tuning writes beside it"
        raise InputError(out, words, "-o NEW.yaml")
    if out.exists():
        raise InputError(out, "a file that is there already", "a new file (-o NEW.yaml)")
    numbers = read_controller_numbers(model.controllers[name], block.free, document, where)
    space = make_space(campaign)
    if any(limit.is_margin for limit in block.limits):
        plan = engine.prepare(model.vehicle, model.mission, model.controllers[name], name)
        _check_margins(block, document, where, plan.timing.duration)
    # Threads: every candidate has a plan of its own, which worker processes would have to be sent and would keep. A
    # crash in compiled code ends the program; the same command then goes on with what is kept.
    execution = model.execution.model_copy(update={"isolation": THREADS})
    text = json.dumps(
        [
            collect_inputs(campaign).judged_identity,
            name,
            block.model_dump(),
            model.seed,
            engine.source,
        ]
    )
    kept = out.with_suffix(_KEPT)
    with hold_lock(kept / ".lock"), ExitStack() as stack:
        scheduler = stack.enter_context(connect(request.scheduler))
        executor = stack.enter_context(open_executor(engine, execution, request.workers, scheduler))
        identity = hashlib.sha256(text.encode()).hexdigest()
        vehicles = vehicles_of(campaign, block)
        candidates = Candidates(campaign, name, numbers, engine)
        asked = {block.minimise.metric, block.usage.metric} & set(MARGIN_NAMES)
        times = model.margins.at if model.margins and asked else ()
        trials = Trials(
            campaign, candidates, space, kept, identity, executor, vehicles, block.margins_at, times
        )
        metrics = campaign.metrics
        flown = trials.draw(model.seed, block.flights)
        (start,) = trials.measure(np.zeros((1, len(block.free))), flown)
        bounds = [bound_of(limit, start) for limit in block.limits]
        with Progress("flights", block.candidates * block.flights) as progress:

            def measure(points: Floats) -> Scores:
                found = trials.measure(points, flown)
                progress.add(len(points) * block.flights)
                return score(found, block, bounds, metrics)

            found = tune(measure, np.zeros(len(block.free)), block.candidates, model.seed)
        result = _validate(trials, block, found, name, metrics)
    if request.tell is not None:
        request.tell(result)
    file = out if result.shown else rejected_file(out)
    if result.shown or found.best != 0:
        comment = _comment(result, request, model.seed)
        write_whole(file, lambda temporary: numbers.write(temporary, found.place, comment))
    return result


def rejected_file(out: Path) -> Path:
    """Return where a candidate that is not shown to be better is kept, beside the file that it would have been."""
    return out.with_suffix(_REJECTED)


def _validate(
    trials: Trials, block: Tune, found: Tuning, name: str, metrics: Mapping[str, Metric]
) -> TuneFound:
    """The result beside the start on flights of another seed."""
    fresh = trials.draw((trials.campaign.model.seed + 1) % 2**63, block.validation)
    start, best = trials.measure(np.stack([np.zeros(len(block.free)), found.place]), fresh)
    aim, usage = block.minimise, block.usage
    of_start, of_best = (severities_of(trial, metrics[aim.metric]) for trial in (start, best))

    def side(entry: Aim) -> Sides:
        at_start, at_best = (
            value_of(trial, metrics[entry.metric], entry.quantile) for trial in (start, best)
        )
        return Sides(
            entry.metric, entry.quantile, None, at_start, at_best, band=metrics[entry.metric].band
        )

    def limited(entry: Limit) -> Sides:
        bound = bound_of(entry, start)
        quantile, vehicles = (
            (None, entry.vehicles or "nominal") if entry.is_margin else (entry.quantile, None)
        )
        at_start, at_best = (limited_value(trial, entry) for trial in (start, best))
        keeps = excess_of(best, entry, bound) <= 0.0
        return Sides(
            entry.metric,
            quantile,
            vehicles,
            at_start,
            at_best,
            bound,
            keeps,
            entry.above is not None,
        )

    limits = tuple(limited(entry) for entry in block.limits)
    points = np.stack([np.zeros(len(block.free)), found.place])
    of_nominal = [trial.margins[0] for trial in (start, best)] if len(trials.vehicles) else None
    least = trials.nominal_margins(points) if of_nominal is None else np.stack(of_nominal)
    limited_margins = {side.metric for side in limits if side.vehicles == "nominal"}
    margins = [
        Sides(metric, None, "nominal", float(least[0, k]), float(least[1, k]))
        for k, metric in enumerate(MARGIN_NAMES)
        if metric not in limited_margins
    ]
    known = [(aim.metric, aim.quantile), *((entry.metric, entry.quantile) for entry in limits)]
    more = () if (usage.metric, usage.quantile) in known else (side(usage),)
    validation = quantile_difference(of_best, of_start, aim.quantile)
    return TuneFound(
        name,
        block,
        trials.candidates.numbers,
        found,
        validation,
        (side(aim), *limits, *more, *margins),
        metrics,
    )


def _comment(found: TuneFound, request: TuneRequest, seed: int) -> str:
    """How the file was made, for its head."""
    aim, gain = found.sides[0], found.difference
    percent = f"{100 * found.block.minimise.quantile:g} % quantile of {aim.metric}"
    command = f"abhv-mc tune {request.campaign} --controller {found.controller} -o {request.output} --seed {seed}"
    command += f" --tune {request.block}" if request.block else ""
    lines = (
        []
        if found.shown
        else ["REJECTED: not shown to be better than the start within the limits."]
    )
    lines += [
        f"Made by `{command}`:",
        f"{len(found.tuning.points)} candidates on {found.block.flights} flights each, the same for all.",
        f"On {found.block.validation} fresh flights the {percent} is {aim.best:.4g} instead of {aim.start:.4g}",
        f"(difference {gain.value:.4g}, 95 % interval {gain.low:.4g} .. {gain.high:.4g}).",
    ]
    for side in found.sides[1:]:
        bound = "" if side.limit is None else f", limit {side.limit:.4g}"
        lines.append(f"{side.words}: {side.best:.4g} instead of {side.start:.4g}{bound}.")
    return "\n".join(lines)
