"""Tests of the robustness of formulas against the definition, evaluated sample by sample."""

import math
import re

import numpy as np
import pytest

from abhv_mc.campaign.file.systems import Response
from abhv_mc.flights.expressions import SourceRow, compile_expression, compile_formula
from abhv_mc.io.messages import Refusal

RATE = 10.0
SIGNALS = ("a", "b", "c")


def draw_formula(generator, values, depth):
    """Return a random formula, and a function that evaluates its definition at a sample."""
    count = values.shape[1]
    kind = generator.integers(6) if depth else 6
    if kind == 6:
        i, limit = generator.integers(len(SIGNALS)), round(generator.normal(), 2)
        is_above = generator.random() < 0.5
        sign = 1.0 if is_above else -1.0
        text = f"{SIGNALS[i]} {'>' if is_above else '<='} {limit}"
        return text, lambda k: sign * (values[i, k] - limit)
    (p, p_at), (q, q_at) = (draw_formula(generator, values, depth - 1) for _ in range(2))
    if kind < 3:
        return [
            (f"(({p}) and ({q}))", lambda k: min(p_at(k), q_at(k))),
            (f"(({p}) or ({q}))", lambda k: max(p_at(k), q_at(k))),
            (f"(({p}) implies ({q}))", lambda k: max(-p_at(k), q_at(k))),
        ][kind]
    first, last = sorted(generator.integers(0, 12, 2).tolist())
    window = f"[{first / RATE}, {last / RATE}]"
    if generator.random() < 0.2:
        first, last, window = 0, count, ""

    def ahead(k):
        return range(k + first, min(k + last, count - 1) + 1)

    def until(k):
        return max((min([q_at(j), *map(p_at, range(k, j))]) for j in ahead(k)), default=-math.inf)

    return [
        (f"always{window}({p})", lambda k: min(map(p_at, ahead(k)), default=math.inf)),
        (f"eventually{window}({p})", lambda k: max(map(p_at, ahead(k)), default=-math.inf)),
        (f"(({p}) until{window} ({q}))", until),
    ][kind - 3]


@pytest.mark.parametrize("count", [200, pytest.param(1000, marks=pytest.mark.thorough)])
def test_robustness_agrees_with_its_definition(count):
    generator = np.random.default_rng(count)
    verdicts = set()
    for _ in range(count):
        values = generator.normal(size=(len(SIGNALS), generator.integers(1, 20)))
        text, expected = draw_formula(generator, values, 3)
        formula = compile_formula(text, RATE)
        samples = np.column_stack([values[SIGNALS.index(name)] for name in formula.sources])
        result, reference = formula.find_robustness(samples, -99.0), expected(0)
        assert result == (reference if math.isfinite(reference) else -99.0), text
        verdicts.add(np.sign(result))
    assert verdicts == {-1.0, 1.0}


def test_the_windows_of_a_response_begin_when_steps_and_ramps_end():
    """Rounding errors of a constant reference are no steps."""
    reference = np.repeat([0.0, 10.0, 20.0, 20.0 + 1e-11, 5.0], [20, 1, 20, 20, 30])
    samples = np.column_stack([reference, np.zeros(reference.size)])
    samples[21:26, 1], samples[61:64, 1], samples[80, 1] = 4.0, 7.0, 2.5
    response = Response(to="a", within="0.5 s", holds="2 s", below="3 m").write_formula("b", "m")
    formula = compile_formula(response, RATE)
    assert formula.find_robustness(samples, np.nan) == 0.5  # by the error at 8 s
    assert np.isnan(formula.find_robustness(samples[:20], np.nan))  # no step
    samples[27, 1] = 4.0  # 0.6 s after the end of the ramp
    assert formula.find_robustness(samples, np.nan) == -1.0


@pytest.mark.parametrize(
    ("text", "rate", "problem"),
    [
        ("a", RATE, "'a'"),
        ("always[2, 1](a < 3)", RATE, "interval (2, 1)"),
        ("a == 3 and a < 3", RATE, "'a == 3'"),
        ("eventually(d > 1)", RATE, "unknown channel 'd'"),
        ("a < 3", 0.0, "'a < 3'"),
        ("step(a)", 0.0, "'step(a)'"),
    ],
)
def test_invalid_formulas_and_expressions_are_rejected(text, rate, problem):
    with pytest.raises(Refusal, match=re.escape(problem)):
        compile_expression(text, dict.fromkeys(SIGNALS, SourceRow("-", 0, 1.0)), rate)
