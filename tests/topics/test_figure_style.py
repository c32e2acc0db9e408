"""Axes, legends and curves that figures share."""

import numpy as np
import pytest

from abhv_mc.topics.figure_style import (
    distribution_steps,
    draw_limits,
    label_lowest,
    log_if_wide,
    new_figure,
    new_panels,
    pad_if_flat,
    put_legend,
)


@pytest.fixture
def axes():
    return new_figure(2.0).subplots()


@pytest.mark.parametrize(("width", "ends"), [(1e-10, (4.0, 6.0)), (0.5, (5.0, 5.5))])
def test_a_constant_curve_is_in_the_middle_of_its_axis(axes, width, ends):
    axes.set_ylim(5.0, 5.0 + width)
    pad_if_flat(axes)
    assert axes.get_ylim() == pytest.approx(ends)


@pytest.mark.parametrize(
    ("count", "columns", "lowest"), [(1, 1, [0]), (2, 2, [0, 1]), (3, 2, [1, 2]), (5, 2, [3, 4])]
)
def test_the_lowest_panel_of_each_column_has_a_label(count, columns, lowest):
    _, grid = new_panels(count, columns, 1.0)
    label_lowest(grid, count, "x")
    assert [k for k, own in enumerate(grid.flat) if own.get_xlabel()] == lowest
    assert [own.get_visible() for own in grid.flat].count(True) == count


@pytest.mark.parametrize(
    ("limit", "ends", "note"),
    [
        (5.0, (0.0, 10.0), ""),
        (9.9, (0.0, 10.2), ""),
        (15.0, (0.0, 15.3), ""),
        (-5.0, (-5.3, 10.0), ""),
        (15.1, (0.0, 10.0), "limit 15.1 m further up"),
        (-5.1, (0.0, 10.0), "limit -5.1 m further down"),
    ],
)
def test_limits_up_to_half_an_axis_beyond_its_ends_are_drawn(axes, limit, ends, note):
    axes.set_ylim(0.0, 10.0)
    notes = draw_limits(axes, "y", [limit], "m")
    assert " ".join(notes).replace("\xa0", " ") == note and len(axes.lines) == (not note)
    assert axes.get_ylim() == pytest.approx(ends)


@pytest.mark.parametrize(
    ("high", "least", "is_log"), [(20.0, 1.0, False), (20.1, 1.0, True), (99.0, 0.0, False)]
)
def test_axes_are_logarithmic_beyond_a_factor_of_20(axes, high, least, is_log):
    values = [np.r_[np.ones(98), least, np.inf], np.full(1, high)]
    assert log_if_wide(axes, "y", values) is is_log
    assert axes.get_yscale() == ("log" if is_log else "linear")


def test_legends_are_read_by_rows_and_shares_count_all_flights(axes):
    handles = [axes.plot([k])[0] for k in range(5)]
    labels = [f"{k}{'x' * 45}" for k in range(5)]  # two fit side by side
    put_legend(axes.figure, handles, labels)
    (legend,) = axes.figure.legends
    assert [text.get_text()[0] for text in legend.get_texts()] == list("02413")
    values = np.random.default_rng(1).permutation(np.r_[np.arange(4500.0), np.full(500, np.inf)])
    steps, shares = distribution_steps(values)
    assert 1700 < steps.size <= 2000 and np.isfinite(steps).all()
    assert shares == pytest.approx((steps + 1.0) / 5000.0) and shares[0] == 1 / 5000
