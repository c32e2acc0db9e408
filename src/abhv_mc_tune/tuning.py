"""Tuning of the free parameters of a controller, with validation (``abhv-mc tune``)."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.bounds import Bounds
from abhv_mc.campaign.file.config import THREADS
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.execution.executor import connect, open_executor
from abhv_mc.execution.progress import Progress
from abhv_mc.flights.metrics import MARGIN_NAMES, Metric
from abhv_mc.folder.inputs import collect_inputs
from abhv_mc.folder.layout import write_whole
from abhv_mc.folder.lock import hold_lock
from abhv_mc.interfaces import Engine
from abhv_mc.io.documents import Document, StrictModel, read_document, validate
from abhv_mc.io.input_files import reading_once
from abhv_mc.io.messages import InputError, counted
from abhv_mc.requests import Paths
from abhv_mc.search.search_flights import find_metric, read_searched
from abhv_mc.search.space import make_space
from abhv_mc.statistics.estimates import Interval
from abhv_mc.statistics.quantile_pairs import quantile_difference
from abhv_mc_tune.candidates import (
    ControllerNumbers,
    Trials,
    bound_of,
    excess_of,
    limited_value,
    read_controller_numbers,
    score,
    severities_of,
    value_of,
    vehicles_of,
)
from abhv_mc_tune.constrained_search import Scores, Tuning, tune
from abhv_mc_tune.request import TuneRequest
from abhv_mc_vehicle.vehicle_simulator.simulator import make_engine
from abhv_mc_vehicle.vehicle_simulator.tuning import Aim, Limit, Tune

# Suffixes of the candidates' folder, the page and the file of a rejected candidate.
_CANDIDATES = ".tuning"
_PAGE = ".html"
_REJECTED = ".rejected.yaml"


@dataclass(frozen=True)
class Comparison:
    """Comparison of start and result on new flights, for one metric or stability margin."""

    metric: str
    quantile: float | None  # quantile of the metric; None for a margin
    vehicles: str | None  # 'nominal' or 'corners' for a margin; None for a metric
    start: float
    best: float
    limit: float | None = None
    keeps: bool = True  # whether the result meets the limit
    floor: bool = False  # whether the limit is a lower bound
    band: Bounds | None = None  # both limits, if values are distances outside the limits

    @property
    def label(self) -> str:
        """Label such as 'altitude_error_rms_m, 95 % quantile' or 'gain_margin_min_db, nominal'."""
        if self.quantile is None:
            vehicles = "nominal and corners" if self.vehicles == "corners" else "nominal"
            return f"{self.metric}, {vehicles}"
        outside = f", distance outside the band {self.band}" if self.band else ""
        return f"{self.metric}{outside}, {100 * self.quantile:g} % quantile"


@dataclass(frozen=True)
class TuneFound:
    """Result of a tuning run."""

    controller: str
    block: Tune
    numbers: ControllerNumbers
    tuning: Tuning
    # objective of the result minus objective of the start; a negative difference is an improvement
    validation: Interval
    # comparisons of the objective, the limits, the control effort and the nominal margins
    comparisons: tuple[Comparison, ...]
    metrics: Mapping[str, Metric]

    @property
    def objective(self) -> Metric:
        """Metric that the tuning minimizes."""
        return self.metrics[self.block.minimise.metric]

    @property
    def difference(self) -> Interval:
        """Quantile for the result minus quantile for the start, in the metric's unit."""
        return self.validation.in_sense(self.objective.bad)

    @property
    def shown(self) -> bool:
        """True if new flights show an improvement and the result is within all limits."""
        return (
            self.tuning.best != 0
            and self.validation.high < 0.0
            and all(item.keeps for item in self.comparisons)
        )

    def as_json(self) -> dict[str, Any]:
        """Return the result as the JSON values that ``--json`` writes."""
        gain = self.difference
        scores = self.tuning.scores
        return {
            "controller": self.controller,
            "metric": self.block.minimise.metric,
            "quantile": self.block.minimise.quantile,
            "shown_better": self.shown,
            "difference": {"value": gain.value, "low": gain.low, "high": gain.high},
            "fresh": [vars(item) for item in self.comparisons],
            "values": self.numbers.values(self.tuning.best_point),
            "at_bounds": self.numbers.at_ends(self.tuning.best_point),
            "candidates": len(self.tuning.points),
            "flights_each": self.block.flights,
            "validation_flights": self.block.validation,
            "front": [
                {
                    "usage": float(scores.usage[i]),
                    "objective": float(scores.objective[i]),
                    "values": self.numbers.values(self.tuning.points[i]),
                }
                for i in self.tuning.front.tolist()
            ],
        }


class _TuneFile(StrictModel):
    tune: Tune


def read_tune_block(
    campaign: Experiment, path: Paths | None
) -> tuple[Tune, Document, tuple[str, ...]]:
    """Return the ``tune`` block with its document and keys.

    Raise InputError if the block is missing.
    """
    keys: tuple[str, ...] = ("tune",)
    document = campaign.document
    if path is None:
        if campaign.model.tune is None:
            raise document.error(
                (),
                "the block 'tune' is missing",
                "'tune: {free: [...], minimise: {metric: ...}}' in the campaign, or --tune FILE",
            )
        block = campaign.model.tune
    else:
        document = read_document(path)
        if isinstance(document.data, dict) and set(document.data) == {"tune"}:
            block = validate(document, _TuneFile).tune
        else:
            block = validate(document, Tune)
            keys = ()
    for location, entry in (
        (("minimise",), block.minimise),
        (("usage",), block.usage),
        *((("limits", i), limit) for i, limit in enumerate(block.limits) if not limit.is_margin),
    ):
        find_metric(campaign, entry.metric, partial(document.error, (*keys, *location, "metric")))
    return block, document, keys


@reading_once()
def tune_controller(request: TuneRequest, engine: Engine | None = None) -> TuneFound:
    """Search for the best parameters, validate them with another seed, and write the file.

    The flights of all candidates are stored next to the new file, so that the same command resumes
    the tuning after an interruption. A candidate that is not shown to be better is written to
    :func:`rejected_file`. Raise InputError if the request is invalid.
    """
    engine = engine or make_engine()
    campaign, name = read_searched(request.campaign, request.controller, request.seed, engine)
    model = campaign.model
    out = Path(request.output)
    campaign.simulator.check("tuning")
    block, document, keys = read_tune_block(campaign, request.block)
    if out.suffix in (_CANDIDATES, _PAGE):
        raise InputError(
            out,
            f"the suffix '{out.suffix}' is used for other files of the tuning",
            "another file (-o NEW.yaml)",
        )
    if out.exists():
        raise InputError(out, "the file already exists", "a new file (-o NEW.yaml)")
    numbers = read_controller_numbers(model.controllers[name], block.free, document, keys)
    space = make_space(campaign)
    if any(limit.is_margin for limit in block.limits):
        plan = engine.prepare(model.vehicle, model.mission, model.controllers[name], name)
        duration = plan.timing.duration
        for i, time in enumerate(block.margins_at):
            if time != "trim" and not 0.0 <= time <= duration:
                raise document.error(
                    (*keys, "margins_at", i),
                    f"found {time:g} s",
                    f"trim, or a time of the mission, 0 to {duration:g} s",
                )
    # Threads are used, because worker processes would keep the plans of all candidates. After a
    # crash, running the same command again resumes the tuning.
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
    folder = out.with_suffix(_CANDIDATES)
    with (
        hold_lock(folder / ".lock"),
        connect(request.scheduler) as scheduler,
        open_executor(engine, execution, request.workers, scheduler) as executor,
    ):
        needs_margins = {block.minimise.metric, block.usage.metric} & set(MARGIN_NAMES)
        trials = Trials(
            campaign=campaign,
            name=name,
            numbers=numbers,
            engine=engine,
            space=space,
            folder=folder,
            identity=hashlib.sha256(text.encode()).hexdigest(),
            executor=executor,
            vehicles=vehicles_of(campaign, block),
            margins_at=block.margins_at,
            flights_at=model.margins.at if model.margins and needs_margins else (),
        )
        metrics = campaign.metrics
        inputs = trials.draw(model.seed, block.flights)
        (start,) = trials.measure(np.zeros((1, len(block.free))), inputs)
        bounds = [bound_of(limit, start) for limit in block.limits]
        with Progress("flights", block.candidates * block.flights) as progress:

            def measure(points: Floats) -> Scores:
                measured = trials.measure(points, inputs)
                progress.add(len(points) * block.flights)
                return score(measured, block, bounds, metrics)

            tuning = tune(measure, np.zeros(len(block.free)), block.candidates, model.seed)
        result = _validate(trials, block, tuning, name, metrics)
    if request.tell is not None:
        request.tell(result)
    file = out if result.shown else rejected_file(out)
    if result.shown or tuning.best != 0:
        comment = _comment(result, request, model.seed)
        write_whole(file, lambda temporary: numbers.write(temporary, tuning.best_point, comment))
    return result


def rejected_file(out: Path) -> Path:
    """Return the path for a candidate that is not shown to be better."""
    return out.with_suffix(_REJECTED)


def _validate(
    trials: Trials, block: Tune, tuning: Tuning, name: str, metrics: Mapping[str, Metric]
) -> TuneFound:
    """Compare the tuned and the initial parameters on flights with another seed."""
    fresh = trials.draw((trials.campaign.model.seed + 1) % 2**63, block.validation)
    points = np.stack([np.zeros(len(block.free)), tuning.best_point])
    start, best = trials.measure(points, fresh)
    aim = block.minimise
    usage = block.usage
    severities = [severities_of(trial, metrics[aim.metric]) for trial in (start, best)]

    def compare(entry: Aim) -> Comparison:
        metric = metrics[entry.metric]
        at_start, at_best = (value_of(trial, metric, entry.quantile) for trial in (start, best))
        return Comparison(entry.metric, entry.quantile, None, at_start, at_best, band=metric.band)

    def compare_limited(entry: Limit) -> Comparison:
        bound = bound_of(entry, start)
        return Comparison(
            metric=entry.metric,
            quantile=None if entry.is_margin else entry.quantile,
            vehicles=(entry.vehicles or "nominal") if entry.is_margin else None,
            start=limited_value(start, entry),
            best=limited_value(best, entry),
            limit=bound,
            keeps=excess_of(best, entry, bound) <= 0.0,
            floor=entry.above is not None,
        )

    limits = tuple(compare_limited(entry) for entry in block.limits)
    smallest = (
        np.stack([trial.margins[0] for trial in (start, best)])
        if len(trials.vehicles)
        else trials.nominal_margins(points)
    )
    limited_margins = {item.metric for item in limits if item.vehicles == "nominal"}
    margins = [
        Comparison(metric, None, "nominal", *values)
        for metric, *values in zip(MARGIN_NAMES, *smallest.tolist(), strict=True)
        if metric not in limited_margins
    ]
    compared = [(aim.metric, aim.quantile), *((entry.metric, entry.quantile) for entry in limits)]
    effort = () if (usage.metric, usage.quantile) in compared else (compare(usage),)
    return TuneFound(
        controller=name,
        block=block,
        numbers=trials.numbers,
        tuning=tuning,
        validation=quantile_difference(severities[1], severities[0], aim.quantile),
        comparisons=(compare(aim), *limits, *effort, *margins),
        metrics=metrics,
    )


def _comment(result: TuneFound, request: TuneRequest, seed: int) -> str:
    """Return the comment at the beginning of the new file."""
    main = result.comparisons[0]
    gain = result.difference
    block = result.block
    command = (
        f"abhv-mc tune {request.campaign} --controller {result.controller} -o {request.output}"
        f" --seed {seed}"
    )
    command += f" --tune {request.block}" if request.block else ""
    lines = [
        *(
            ()
            if result.shown
            else ("REJECTED: not shown to be better than the start within the limits.",)
        ),
        f"Made by `{command}`:",
        f"{counted(len(result.tuning.points), 'candidate')} on the same "
        f"{counted(block.flights, 'flight')}.",
        f"On {counted(block.validation, 'new flight')}, the {100 * block.minimise.quantile:g} % "
        f"quantile of {main.metric} is {main.best:.4g} instead of {main.start:.4g}",
        f"(difference {gain.value:.4g}, 95 % interval {gain.low:.4g} .. {gain.high:.4g}).",
    ]
    for item in result.comparisons[1:]:
        bound = "" if item.limit is None else f", limit {item.limit:.4g}"
        lines.append(f"{item.label}: {item.best:.4g} instead of {item.start:.4g}{bound}.")
    return "\n".join(lines)
