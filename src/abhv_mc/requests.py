"""Options of runs and searches, used as function arguments and command-line options.

Each option is declared once, as a field of a request: :func:`takes` makes it an argument of a
Python function, and :mod:`abhv_mc.cli.options` makes it an option of a command.
"""

import functools
import inspect
import os
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from numbers import Integral
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, ParamSpec, TypeAlias, TypeVar, get_args

from abhv_mc.campaign import MOST_WORKERS
from abhv_mc.io.messages import InputError, Refusal, found_value
from abhv_mc.shipped import find_input

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
Paths: TypeAlias = str | os.PathLike[str]


class Option(NamedTuple):
    """Description of one field of a request, for Python and the command line."""

    help: str
    kind: str  # kind of value in `abhv_mc.cli.options`; '' if only Python has the option
    default: str | None = None  # description of the default value, if one is needed
    low: Any = None  # smallest allowed number; `high` is the largest
    high: Any = None


def options_of(request: type) -> dict[str, Option]:
    """Return the descriptions of a request's fields, by field name."""
    return {field.name: get_args(field.type)[1] for field in fields(request)}


def check_count(value: int, least: int, name: str, most: int | None = None) -> int:
    """Return `value` as an int. Raise InputError unless `least` <= `value` <= `most`."""
    is_integer = isinstance(value, Integral) and not isinstance(value, bool)
    if not is_integer or value < least or (most is not None and value > most):
        raise InputError(
            name,
            found_value(value),
            f"a whole number, {least} or more"
            if most is None
            else f"a whole number from {least} to {most}",
        )
    return int(value)


def _check_number(value: float | str, name: str, option: Option) -> float:
    number = float(value)
    if not option.low <= number <= option.high:
        raise InputError(
            name, f"{number:g} is out of range", f"a number from {option.low:g} to {option.high:g}"
        )
    return number


def _check_share(value: float | str, name: str, option: Option) -> float:
    from abhv_mc.io.units import FRACTION, parse_quantity

    try:
        return _check_number(parse_quantity(value, FRACTION), name, option)
    except Refusal as refusal:
        raise InputError(name, refusal.found, refusal.expected) from None


def _check_side(value: object, name: str, _option: Option) -> object:
    if value not in ("high", "low"):
        raise InputError(name, found_value(value), "'high', 'low' or None")
    return value


_CHECKS: dict[
    str, Callable[[Any, str, Option], Any]
] = {  # functions that convert and check a value, by kind of option
    **dict.fromkeys(
        ("address", "file", "folder", "new file", "results"), lambda value, *_: Path(value)
    ),
    "campaign": lambda value, *_: find_input(os.fspath(value), "campaign"),
    "controllers": lambda value, *_: tuple(value),
    "count": lambda value, name, option: check_count(value, option.low, name, option.high),
    "number": _check_number,
    "share": _check_share,
    "side": _check_side,
}

CampaignPath = Annotated[Paths, Option("Campaign file, or the name of a shipped file.", "campaign")]
Controller = Annotated[
    str | None, Option("Controller to use.", "controller", "the only controller under test")
]
Seed = Annotated[
    int | None, Option("Seed of the random numbers.", "count", "the campaign's seed", low=0)
]
Workers = Annotated[
    int | None,
    Option(
        "Number of blocks of flights computed in parallel.",
        "count",
        "number of cores",
        low=1,
        high=MOST_WORKERS,
    ),
]
Scheduler = Annotated[
    str | None,
    Option(
        "Address of the Dask scheduler that runs the flights, such as tcp://host:8786.", "scheduler"
    ),
]
Fresh = Annotated[
    bool, Option("Delete an existing campaign in the folder and start again.", "flag")
]


def parse_pairs(
    option: str, texts: Sequence[str], expected: str, parse: Callable[[str], T]
) -> dict[str, T]:
    """Return the values of texts such as ``NAME=VALUE`` by name.

    Raise InputError if a text is invalid, if a name is repeated or if `parse` raises ValueError.
    """
    pairs: dict[str, T] = {}
    for text in texts:
        name, _, value = map(str.strip, text.partition("="))
        if name in pairs:
            raise InputError(option, f"'{name}' is given twice", "each name only once")
        try:
            pairs[name] = parse(value)
        except ValueError:
            raise InputError(option, f"found '{text}'", expected) from None
    return pairs


class CheckedRequest:
    """Base class of requests, whose values are converted and checked on construction."""

    def __post_init__(self) -> None:
        """Convert and check each value. Raise InputError, naming the field, if one is invalid."""
        for name, option in options_of(type(self)).items():
            value, check = getattr(self, name), _CHECKS.get(option.kind)
            if value is not None and check is not None:
                object.__setattr__(self, name, check(value, name, option))


@dataclass(frozen=True)
class Request(CheckedRequest):
    """Options of a run that is started from the command line, a notebook or a merge."""

    campaign: CampaignPath
    output: Annotated[
        Paths | None,
        Option(
            "Results folder, or an address such as s3://bucket/folder.", "address", "reports/NAME"
        ),
    ] = None
    runs: Annotated[
        int | None,
        Option("Number of flights per controller.", "count", "the campaign's number", low=1),
    ] = None
    seed: Seed = None
    controllers: Annotated[
        Sequence[str] | None,
        Option("Controllers to simulate, instead of all in the campaign file.", "controllers"),
    ] = None
    workers: Workers = None
    fresh: Fresh = False
    scheduler: Scheduler = None
    shard: Annotated[
        tuple[int, int] | None, Option("Run only shard I of N; 'merge' joins the shards.", "shard")
    ] = None
    plans: Annotated[
        Paths | None,
        Option(
            "Results folder whose stored flight plans are used, for bit-identical results.",
            "results",
            "new plans",
        ),
    ] = None
    trust_code: Annotated[
        bool,
        Option(
            "Allow the campaign's custom code to run even if it has not been run on this machine "
            "before.",
            "flag",
        ),
    ] = False
    check_workers: Annotated[
        bool,
        Option(
            "Re-run one flight of each worker locally and check that the results are "
            "bit-identical.",
            "flag",
        ),
    ] = False
    baseline: Annotated[
        Paths | None,
        Option(
            "Results folder of an earlier campaign with the same samples. The values of its "
            "unknown parameters are simulated too, and the report lists the changes.",
            "results",
        ),
    ] = None


@dataclass(frozen=True)
class SearchRequest(CheckedRequest):
    """Options common to all searches."""

    campaign: CampaignPath
    output: Annotated[
        Paths,
        Option(
            "Results folder for the flights and the page.", "folder", "reports/CAMPAIGN_SEARCH_NAME"
        ),
    ]
    _: KW_ONLY
    controller: Controller = None
    seed: Seed = None
    workers: Workers = None
    scheduler: Scheduler = None
    fresh: Fresh = False

    @property
    def settings(self) -> dict[str, Any]:
        """Options specific to this kind of search that affect its result."""
        specific = fields(self)[len(fields(SearchRequest)) :]
        return {field.name: getattr(self, field.name) for field in specific}


@dataclass(frozen=True)
class WorstRequest(SearchRequest):
    """Options of a search for the worst value of a metric."""

    metric: Annotated[str, Option("Metric whose worst value is sought.", "metric")]
    _: KW_ONLY
    bad: Annotated[
        Literal["high", "low"] | None,
        Option("Treat high or low values as worse.", "side", "the worse direction of the metric"),
    ] = None
    flights: Annotated[
        int,
        Option(
            "Number of flights of the search; the same number of random flights is added.",
            "count",
            low=1,
        ),
    ] = 2000
    box: Annotated[
        float,
        Option(
            "Half-width of the searched range of unbounded distributions, in standard deviations.",
            "number",
            low=0.1,
            high=8.0,
        ),
    ] = 3.0


@dataclass(frozen=True)
class RareRequest(SearchRequest):
    """Options of an estimate of a failure probability."""

    requirement: Annotated[
        str,
        Option(
            "Requirement (ID or metric) whose probability of violation is estimated.", "requirement"
        ),
    ]
    _: KW_ONLY
    target_cov: Annotated[
        float | str,
        Option(
            "Target coefficient of variation of the estimate, such as 0.2 or 20 %.",
            "share",
            low=0.01,
            high=1.0,
        ),
    ] = 0.2
    flights: Annotated[
        int | None,
        Option("Maximum number of flights.", "count", "20000, or 400 with a surrogate", low=1),
    ] = None
    surrogate: Annotated[
        bool,
        Option(
            "Use a Gaussian-process surrogate of the metric, for slow simulators with at most 10 "
            "dispersions that affect the metric smoothly.",
            "flag",
        ),
    ] = False

    @property
    def most_flights(self) -> int:
        """Maximum number of flights of the search."""
        return self.flights or (400 if self.surrogate else 20_000)

    @property
    def settings(self) -> dict[str, Any]:
        """Options specific to this search, with the maximum number of flights."""
        return {**super().settings, "flights": self.most_flights}


def takes(
    request: Callable[P, R], method_of: str = ""
) -> Callable[[Callable[[R], T]], Callable[P, T]]:
    """Return a decorator that makes the fields of a request the arguments of a function.

    The decorator also sets the signature and docstring. For a method, ``method_of`` is the field
    that receives the object (``self``).
    """

    def decorate(function: Callable[[R], T]) -> Callable[P, T]:
        def call(*arguments: P.args, **options: P.kwargs) -> T:
            return function(request(*arguments, **options))

        wrapper: Any = functools.update_wrapper(call, function)
        del wrapper.__wrapped__
        described: Any = request
        parameters = [
            parameter.replace(annotation=get_args(parameter.annotation)[0])
            for parameter in inspect.signature(request).parameters.values()
        ]
        returned = inspect.signature(function).return_annotation
        wrapper.__signature__ = inspect.Signature(parameters, return_annotation=returned)
        lines, options = ["Parameters", "----------"], options_of(described)
        for parameter in (parameter for parameter in parameters if parameter.name != method_of):
            option, is_required = options[parameter.name], parameter.default is parameter.empty
            default = (
                f" By default: {option.default}." if option.default and not is_required else ""
            )
            lines += [parameter.name, f"    {option.help}{default}"]
        text, returns, after = inspect.cleandoc(function.__doc__ or "").partition("Returns\n---")
        wrapper.__doc__ = text + "\n".join(lines) + "\n\n" + returns + after
        return call

    return decorate
