"""Distributions in campaign files, and their conversion to marginals.

Values have the unit of the parameter; values of a factor are numbers or percentages. For a factor,
``half_width`` and ``sigma`` are relative to the nominal value 1. For an error, they are deviations
from the nominal value 0 in the parameter's unit.
"""

import math
from abc import abstractmethod
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from abhv_mc.array_types import Floats
from abhv_mc.campaign.sampling.marginals import (
    ContinuousMarginal,
    DiscreteMarginal,
    Marginal,
    MixtureMarginal,
    SometimesMarginal,
)
from abhv_mc.flights.parameters import Parameter
from abhv_mc.io.documents import StrictModel
from abhv_mc.io.messages import Refusal, counted, one_of, quoted
from abhv_mc.io.units import Fraction

Value = float | str  # a number, or a string with a unit

_NUMBER = Parameter("number", "-", 1.0, "")
_KIND = Field(description="kind of distribution")
_Weights = tuple[Annotated[float, Field(gt=0.0)], ...]


class _Distribution(StrictModel):
    distribution: str = _KIND
    probability: Annotated[Fraction, Field(gt=0.0, le=1.0)] = 1.0
    """probability that the drawn value applies; otherwise the nominal value is used"""

    varies_by: Literal["vehicle", "flight"] | None = None
    """'vehicle': flights of one vehicle share the value in `abhv-mc compare` and `identify`;
    'flight': each flight has its own; default: flight for the atmosphere, wind, initial errors,
    noise and failures, else vehicle"""

    @abstractmethod
    def draw_from(self, parameter: Parameter) -> Marginal:
        """Return the marginal in SI units, without ``probability``. Raise Refusal if invalid."""

    def make_marginal(self, parameter: Parameter) -> Marginal:
        """Return the marginal in SI units, including ``probability``. Raise Refusal if invalid."""
        drawn = self.draw_from(parameter)
        if self.probability < 1.0:
            return SometimesMarginal(drawn, self.probability, parameter.nominal)
        return drawn

    def _read(self, key: str, parameter: Parameter) -> float | None:
        if (value := getattr(self, key)) is None:
            return None
        return _read(parameter, value, key, of_nominal=key in ("half_width", "sigma"))

    def _center(self, key: str, parameter: Parameter) -> float:
        """Return a mean, mode or median, by default the nominal value."""
        value = self._read(key, parameter)
        if value is None and not math.isfinite(parameter.nominal):
            raise Refusal(
                "the parameter has an infinite nominal value",
                "an explicit mean, mode or median",
            )
        return parameter.nominal if value is None else value

    def _positive(self, key: str, parameter: Parameter) -> float:
        value = self._read(key, parameter)
        if value is None or value <= 0.0:
            raise Refusal(f"found {getattr(self, key)}", f"a positive {key}", (key,))
        return value


class _Ranged(_Distribution):
    half_width: Value | None = None
    """distance from the nominal value (mean, mode) to either end; replaces low and high"""
    low: Value | None = None
    """lower end of the range"""
    high: Value | None = None
    """upper end of the range"""

    def _range(self, parameter: Parameter, center: float) -> tuple[float, float]:
        """Return the range from ``half_width`` about ``center``, or from ``low`` and ``high``."""
        low, high = self._read("low", parameter), self._read("high", parameter)
        if self.half_width is not None:
            if low is not None or high is not None:
                raise Refusal(
                    "half_width cannot be combined with low or high",
                    "either half_width alone, or both low and high",
                )
            if not math.isfinite(center):
                raise Refusal(
                    f"the center of the range is {center:g}",
                    "low and high instead of half_width",
                    ("half_width",),
                )
            half_width = self._positive("half_width", parameter)
            return center - half_width, center + half_width
        if low is None or high is None:
            raise Refusal("the range is missing", "half_width alone, or both low and high")
        if not low < high:
            raise Refusal(
                f"the range from {low:g} to {high:g} is empty",
                "'low' to be less than 'high'",
                ("high",),
            )
        return low, high


class Uniform(_Ranged):
    """Uniform distribution on a range."""

    distribution: Literal["uniform"] = _KIND

    def draw_from(self, parameter: Parameter) -> Marginal:
        low, high = self._range(parameter, parameter.nominal)
        return ContinuousMarginal("uniform", (low, high - low))


class Normal(_Distribution):
    """Normal distribution."""

    distribution: Literal["normal"] = _KIND
    sigma: Value
    """standard deviation"""
    mean: Value | None = None
    """mean; default: the nominal value"""

    def draw_from(self, parameter: Parameter) -> Marginal:
        mean, sigma = self._center("mean", parameter), self._positive("sigma", parameter)
        return ContinuousMarginal("norm", (mean, sigma))


class TruncatedNormal(_Ranged):
    """Normal distribution truncated to a range, without probability mass at the ends."""

    distribution: Literal["truncated_normal"] = _KIND
    sigma: Value
    """standard deviation before truncation"""
    mean: Value | None = None
    """mean before truncation; default: the nominal value"""

    def draw_from(self, parameter: Parameter) -> Marginal:
        from scipy.special import ndtr

        mean, sigma = self._center("mean", parameter), self._positive("sigma", parameter)
        low, high = self._range(parameter, mean)
        ends = (low - mean) / sigma, (high - mean) / sigma
        if not ndtr(ends[1]) - ndtr(ends[0]) > 1e-9:
            raise Refusal(
                "the normal distribution has practically no probability in the range",
                "a range nearer to the mean",
                ("sigma",),
            )
        return ContinuousMarginal("truncnorm", (*ends, mean, sigma))


class Triangular(_Ranged):
    """Triangular distribution."""

    distribution: Literal["triangular"] = _KIND
    mode: Value | None = None
    """most likely value; default: the nominal value"""

    def draw_from(self, parameter: Parameter) -> Marginal:
        mode = self._center("mode", parameter)
        low, high = self._range(parameter, mode)
        if not low <= mode <= high:
            raise Refusal(
                f"the mode {mode:g} is outside the range from {low:g} to {high:g}",
                "a mode within the range",
            )
        return ContinuousMarginal("triang", ((mode - low) / (high - low), low, high - low))


class Lognormal(_Distribution):
    """Lognormal distribution."""

    distribution: Literal["lognormal"] = _KIND
    sigma: Value
    """standard deviation of the natural logarithm, as a number or percentage"""
    median: Value | None = None
    """median; default: the nominal value"""

    def draw_from(self, parameter: Parameter) -> Marginal:
        sigma = _read(_NUMBER, self.sigma, "sigma")
        median = self._center("median", parameter)
        if sigma <= 0.0:
            raise Refusal(f"found {self.sigma}", "a positive sigma", ("sigma",))
        if median <= 0.0:
            where = ("median",) if self.median is not None else ()
            raise Refusal(f"the median is {median:g}", "a positive median", where)
        return ContinuousMarginal("lognorm", (sigma, 0.0, median))


class Beta(_Ranged):
    """Beta distribution with shape parameters a and b, scaled to a range."""

    distribution: Literal["beta"] = _KIND
    a: Annotated[float, Field(gt=0.0)]
    """first shape parameter"""
    b: Annotated[float, Field(gt=0.0)]
    """second shape parameter"""

    def draw_from(self, parameter: Parameter) -> Marginal:
        low, high = self._range(parameter, parameter.nominal)
        return ContinuousMarginal("beta", (self.a, self.b, low, high - low))


class Discrete(_Distribution):
    """Discrete distribution with equal or specified weights."""

    distribution: Literal["discrete"] = _KIND
    values: Annotated[tuple[Value, ...], Field(min_length=2)]
    """values to draw from"""
    weights: _Weights | None = None
    """weight of each value; default: equal weights"""

    def draw_from(self, parameter: Parameter) -> Marginal:
        values = np.array(
            [_read(parameter, value, "values", i) for i, value in enumerate(self.values)]
        )
        weights = _shares(self.weights, len(values))
        if len(np.unique(values)) != len(values):
            raise Refusal("a value is listed twice", "different values", ("values",))
        order = np.argsort(values)
        cumulative = np.cumsum(weights[order])
        cumulative[-1] = 1.0
        return DiscreteMarginal(values[order], cumulative)


class Scipy(_Distribution):
    """Continuous distribution of scipy.stats, with shape parameters, location and scale."""

    distribution: Literal["scipy"] = _KIND
    law: str
    """name of a continuous distribution of scipy.stats, such as weibull_min"""
    shapes: dict[str, float] = {}
    """shape parameters by name"""
    loc: Value | None = None
    """location in SI units; default: 0"""
    scale: Value | None = None
    """scale in SI units; default: 1"""

    def draw_from(self, parameter: Parameter) -> Marginal:
        from scipy import stats

        names = [name for name, law in vars(stats).items() if isinstance(law, stats.rv_continuous)]
        if self.law not in names:
            raise Refusal(f"unknown distribution '{self.law}'", one_of(names, self.law), ("law",))
        law = getattr(stats, self.law)
        shapes = [
            name.strip() for name in (law.shapes or "").split(",") if name.strip()
        ]  # shape parameters, in the order that scipy expects
        if sorted(self.shapes) != sorted(shapes):
            problem = (
                f"found the shapes {quoted(self.shapes)}" if self.shapes else "found no shapes"
            )
            named = f"the shapes {quoted(shapes)}" if shapes else "no shapes"
            raise Refusal(problem, f"{named} for '{self.law}'")
        scale = 1.0 if self.scale is None else self._positive("scale", parameter)
        loc = self._read("loc", parameter) or 0.0
        marginal = ContinuousMarginal(
            self.law, (*(self.shapes[name] for name in shapes), loc, scale)
        )
        if not np.all(np.isfinite(marginal.ppf(np.array([1e-6, 0.5, 1.0 - 1e-6])))):
            raise Refusal(
                f"the shape parameters are outside the domain of '{self.law}'",
                "shape parameters for which the distribution is defined",
            )
        return marginal


_Simple = Uniform | Normal | TruncatedNormal | Triangular | Lognormal | Beta | Discrete | Scipy
_Part = Annotated[_Simple, Field(discriminator="distribution")]


class Mixture(_Distribution):
    """Mixture of distributions with equal or specified weights."""

    distribution: Literal["mixture"] = _KIND
    parts: Annotated[tuple[_Part, ...], Field(min_length=2)]
    """distributions to mix"""
    weights: _Weights | None = None
    """weight of each distribution; default: equal weights"""

    def draw_from(self, parameter: Parameter) -> Marginal:
        weights, drawn = _shares(self.weights, len(self.parts)), []
        for i, component in enumerate(self.parts):
            if component.probability < 1.0:
                raise Refusal(
                    "a component of the mixture has the key 'probability'",
                    "a weight for the component, or a probability for the whole mixture",
                    ("parts", i),
                )
            try:
                drawn.append(component.draw_from(parameter))
            except Refusal as refusal:
                raise Refusal(
                    refusal.found, refusal.expected, ("parts", i, *refusal.keys)
                ) from None
        choices = [component for component in drawn if isinstance(component, DiscreteMarginal)]
        if len(choices) < len(drawn):
            return MixtureMarginal(tuple(drawn), tuple(weights.tolist()))
        values = np.unique(np.concatenate([component.values for component in choices]))
        cumulative = np.cumsum(
            sum(
                w * component.density(values) for w, component in zip(weights, choices, strict=True)
            )
        )
        return DiscreteMarginal(values, np.append(cumulative[:-1], 1.0))


Distribution = Annotated[_Simple | Mixture, Field(discriminator="distribution")]


def _read(parameter: Parameter, value: Value, *keys: str | int, of_nominal: bool = False) -> float:
    try:
        return parameter.read(value, of_nominal)
    except Refusal as refusal:
        raise Refusal(refusal.found, refusal.expected, tuple(keys)) from None


def _shares(weights: tuple[float, ...] | None, number: int) -> Floats:
    """Return normalized weights, which are equal if ``weights`` is None."""
    shares = np.array([1.0] * number if weights is None else weights)
    if len(shares) != number:
        raise Refusal(
            f"found {counted(len(shares), 'weight')}", counted(number, "weight"), ("weights",)
        )
    return shares / shares.sum()
