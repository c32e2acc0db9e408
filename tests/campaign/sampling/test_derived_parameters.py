"""Inputs that follow from others: computed last, from the row, wherever a row of the samples becomes a flight's."""

from pathlib import Path

import numpy as np
import pytest
from fake_flight import write_campaign
from scipy import stats

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.sampling.derived_parameters import compile_derived
from abhv_mc.io.documents import InputError, Refusal
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.search.space import make_space

LIFT, DRAG, BANK = (PARAMETER_INDEX[name] for name in ("aero.lift", "aero.drag", "initial.bank"))
_BOTH = "{aero.lift: {distribution: normal, sigma: 5 %}, aero.drag: {distribution: normal, sigma: 2 %}}"


def drawn(folder: Path, **entries: str):
    campaign = read_campaign(write_campaign(folder, **entries))
    values = campaign.make_samples().draw(0, campaign.runs)
    return campaign, values, campaign.rows(values)


def test_a_derived_input_is_the_expression_of_the_row(tmp_path: Path):
    campaign, values, rows = drawn(tmp_path, derived="{aero.drag: 1 + 0.5 * (aero.lift - 1)}")
    assert campaign.names == ("atmosphere.density", "aero.lift")
    assert np.array_equal(rows[:, DRAG], 1.0 + 0.5 * (values[:, 1] - 1.0))
    assert np.array_equal(rows[:, LIFT], values[:, 1])


def test_what_is_dispersed_may_stand_on_its_own_right_side_and_correlates_as_it_must(tmp_path: Path):
    """Drag is lift's share and its own scatter: r = 0.5 s_l / sqrt(0.25 s_l^2 + s_d^2)."""
    formula = "{aero.drag: aero.drag + 0.5 * (aero.lift - 1)}"
    campaign, values, rows = drawn(tmp_path, dispersions=_BOTH, derived=formula, runs="20000")
    assert np.array_equal(rows[:, DRAG], values[:, 1] + 0.5 * (values[:, 0] - 1.0))
    expected = 0.025 / np.hypot(0.025, 0.02)
    assert np.corrcoef(rows[:, LIFT], rows[:, DRAG])[0, 1] == pytest.approx(expected, abs=0.01)
    assert stats.kstest(rows[:, DRAG], stats.norm(1.0, np.hypot(0.025, 0.02)).cdf).pvalue > 1e-3
    assert abs(np.corrcoef(values.T)[0, 1]) < 0.02  # the table holds what is drawn
    assert np.array_equal(campaign.rows(values[7:8])[0], rows[7])
    assert np.array_equal(make_space(campaign).rows(values), rows)


def test_functions_and_infinite_values(tmp_path: Path):
    derived = compile_derived(
        "initial.bank", "max(sin(initial.heading), -0.5, cos(0) - 2) / sqrt(4) + abs(-0.25) - 0.25"
    )
    rows = np.zeros((3, 1 + max(PARAMETER_INDEX.values())))
    rows[:, PARAMETER_INDEX["initial.heading"]] = 0.3, -1.0, 0.0
    assert derived.evaluate(rows) == pytest.approx([np.sin(0.3) / 2, -0.25, 0.0], abs=1e-16)
    _, _, rows = drawn(
        tmp_path,
        dispersions="{failure.aileron.stuck_time: {distribution: uniform, low: 5 s, high: 50 s, probability: 5 %}}",
        derived="{failure.rudder.stuck_time: failure.aileron.stuck_time + 2}",
    )
    times = rows[:, [PARAMETER_INDEX[f"failure.{name}.stuck_time"] for name in ("aileron", "rudder")]]
    assert np.array_equal(times[:, 1], times[:, 0] + 2.0) and 0 < np.isfinite(times).all(axis=1).sum() < 30


def test_noise_that_is_derived_has_its_seeds(tmp_path: Path):
    campaign = read_campaign(write_campaign(tmp_path, derived="{wind.turbulence: 3 * abs(aero.lift - 1)}"))
    assert campaign.make_samples().names[-1] == "wind.turbulence_seed"
    assert make_space(campaign).seeds == ("wind.turbulence_seed",)


@pytest.mark.parametrize(
    "entry, words",
    [
        ("{aero.darg: aero.lift}", "'aero.darg'.*'aero.drag'"),
        ("{aero.drag: 2 * aero.lfit}", "'aero.lfit'.*'aero.lift'"),
        ("{aero.drag: 1 + lift}", "'lift'"),
        ("{aero.drag: aero.lift ** 2}", r"aero\.lift \*\* 2"),
        ("{aero.drag: aero.lift + 0.05}", "1.05 where all others are nominal"),
        ("{aero.drag: aero.lift, aero.side_force: aero.drag}", "'aero.drag', which is derived itself"),
        ("{wind.turbulence_seed: aero.lift}", "a seed"),
    ],
)
def test_refused(tmp_path: Path, entry: str, words: str):
    with pytest.raises((InputError, Refusal), match=words):
        read_campaign(write_campaign(tmp_path, derived=entry))
