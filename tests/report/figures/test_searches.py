"""Curves, bars, bands and limits of the figures of searches and of planned campaigns."""

from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.report.figures.searches import (
    plot_convergence,
    plot_failures,
    plot_flights,
    plot_learning,
    plot_levels,
    plot_mixing,
    plot_planned,
    plot_worst_point,
)

NAN = np.nan
FLAT = np.array([3.0, 3.0 + 1e-10])  # constant but for rounding errors


def lines(axes):
    """Return labels and points of all lines; those without a label have the label ''."""
    found = ((line.get_label(), line.get_xydata().tolist()) for line in axes.lines)
    return [("" if label.startswith("_") else label, points) for label, points in found]


def across(y, label="limit"):
    return label, [[0.0, y], [1.0, y]]


def upright(x, label=""):
    return label, [[x, 0.0], [x, 1.0]]


def band(collection):
    """Return [x, lowest, highest] of a band or box at each x."""
    x, y = np.concatenate([path.vertices for path in collection.get_paths()]).T
    return [[at, y[x == at].min(), y[x == at].max()] for at in np.unique(x)]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_convergence_counts_flights_from_one_and_marks_stages():
    stages = [(0, "a"), (2, "b"), (3, "c")]
    figure = plot_convergence("error (m)", np.array([1.0, 5.0]), np.full(3, 2.0), stages, (4.0,))
    axes = figure.axes[0]
    np.testing.assert_equal(lines(axes), [
        ("random, same box", [[1.0, 2.0], [2.0, 2.0], [3.0, 2.0]]),
        ("search", [[1.0, 1.0], [2.0, 5.0]]),
        across(4.0),
        *(upright(start) for start, _ in stages),
    ])  # fmt: skip
    places = [(text.get_text(), *text.xy) for text in axes.texts if text.get_text() in "abc"]
    assert [(name, x) for name, x, _ in places] == [("a", 0), ("b", 2), ("c", 3)]
    assert places[0][2] == places[2][2] < places[1][2]  # names of neighbours do not overlap
    assert "error (m)" in axes.get_ylabel() and axes.get_xlabel() == "flights"
    flat = plot_convergence("x", FLAT, FLAT, []).axes[0]
    assert flat.get_ylim() == pytest.approx((2.0, 4.0)) and len(legend(figure)) == 3


def test_the_worst_point_has_a_row_with_two_bars_for_each_parameter():
    change = np.array([[-1.0, 2.0], [3.0, NAN]])
    figure = plot_worst_point(("lift", "drag"), np.array([-0.5, 1.0]), change, "error (m)")
    left, right = figure.axes
    assert lines(left) == [("", [[-0.5, 0.0], [1.0, 1.0]])]
    np.testing.assert_equal(left.collections[0].get_segments(), [
        [[-1.0, row], [1.0, row]] for row in (0.0, 1.0)])  # fmt: skip
    names = [text.get_text() for text in left.get_yticklabels()]
    assert (names, left.get_yticks().tolist()) == (["lift", "drag"], [0.0, 1.0])
    assert left.get_ylim() == right.get_ylim() == (1.5, -0.5)  # the first row is at the top
    ends = [text.get_text().split()[0] for text in left.get_xticklabels()]
    assert (ends, left.get_xticks().tolist()) == (["low", "middle", "high"], [-1.0, 0.0, 1.0])
    for bars, column, side in zip(right.containers, change.T, (-1, 1), strict=True):
        np.testing.assert_equal([bar.get_width() for bar in bars], column)
        middles = [bar.get_y() + bar.get_height() / 2.0 - row for row, bar in enumerate(bars)]
        assert np.sign(middles).tolist() == [side, side]
    assert [bars.get_label().split()[0] for bars in right.containers] == ["decrease", "increase"]
    assert lines(right) == [upright(0.0)] and right.get_xlabel() == "change of error (m)"
    more = plot_worst_point(tuple("abcd"), np.zeros(4), np.zeros((4, 2)), "error (m)")
    assert more.get_figheight() > figure.get_figheight() + 0.4


def test_levels_are_curves_of_repetitions_on_a_logarithmic_axis():
    curves = [(np.array([1.0, k]), np.array([0.1, 0.01 * k])) for k in (2.0, 3.0)]
    axes = plot_levels("error (m)", 4.0, curves).axes[0]
    assert lines(axes) == [
        ("repetition 1", [[1.0, 0.1], [2.0, 0.02]]),
        ("repetition 2", [[1.0, 0.1], [3.0, 0.03]]),
        upright(4.0, "limit"),
    ]
    assert axes.get_yscale() == "log" and axes.get_xlabel() == "error (m)"
    looks = {(line.get_color(), line.get_marker()) for line in axes.lines[:2]}
    assert len({color for color, _ in looks}) == len({marker for _, marker in looks}) == 2


def test_learning_shows_both_processes_their_interval_and_the_flights():
    """A zero cannot be drawn on a logarithmic axis; a lower bound of 0 is below all values."""
    steps = np.array([[10.0, 0.0, 0.3, 0.0, 0.5], [20.0, 0.1, 0.2, 0.05, 0.4]])
    figure = plot_learning("error (m)", [7.0, -7.0], steps, np.array([1.0, 3.0]))
    left, right = figure.axes
    found = dict(lines(left))
    assert left.get_yscale() == "log" and list(found) == ["Matern process", "smooth process"]
    np.testing.assert_equal(found["Matern process"], [[10.0, NAN], [20.0, 0.1]])
    np.testing.assert_equal(found["smooth process"], [[10.0, 0.3], [20.0, 0.2]])
    np.testing.assert_allclose(band(left.collections[0]), [[10.0, 0.005, 0.5], [20.0, 0.05, 0.4]])
    assert lines(right) == [("flight", [[0.0, 1.0], [1.0, 3.0]]), across(7.0), across(-7.0)]
    assert [axes.get_xlabel() for axes in figure.axes] == ["flights"] * 2
    assert right.get_ylabel() == "error (m)" and legend(figure) == [
        "interval", "Matern process", "smooth process", "flight", "limit"]  # fmt: skip


def test_mixing_begins_at_the_second_level():
    rates, sizes = [np.array([0.4, 0.5]), np.array([0.3])], [np.array([1.0, 0.8]), np.array([0.9])]
    left, right = plot_mixing(rates, sizes, 0.44).axes
    assert lines(left) == [("", [[2.0, 0.4], [3.0, 0.5]]), ("", [[2.0, 0.3]]), across(0.44, "")]
    assert lines(right) == [("", [[2.0, 1.0], [3.0, 0.8]]), ("", [[2.0, 0.9]])]
    assert left.get_ylabel().startswith("accepted") and right.get_ylabel().startswith("size")
    for axes in (left, right):
        assert axes.get_ylim() == (0.0, 1.05) and not np.any(axes.get_xticks() % 1.0)


def test_failures_are_boxes_of_their_quantiles():
    points = np.linspace([0.0, -10.0], [40.0, 10.0], 41)
    axes = plot_failures(("lift", "drag"), points).axes[0]
    boxes = {item.get_label(): item for item in axes.collections}
    for label, ends in (
        ("95 % of failures", [[1.0, 39.0], [-9.5, 9.5]]),
        ("half of failures", [[10.0, 30.0], [-5.0, 5.0]]),
    ):
        segments = np.array(boxes[label].get_segments())
        np.testing.assert_allclose(segments[:, :, 0], ends)
        np.testing.assert_equal(segments[:, :, 1], [[0.0, 0.0], [1.0, 1.0]])
    assert lines(axes) == [("their median", [[20.0, 0.0], [0.0, 1.0]])]
    (all_flights,) = axes.patches
    assert (all_flights.get_x(), all_flights.get_width()) == pytest.approx((-1.96, 3.92))
    names = [text.get_text() for text in axes.get_yticklabels()]
    assert (names, axes.get_ylim()) == (["lift", "drag"], (1.5, -0.5))


def test_flights_end_with_a_cross_and_the_limits_are_in_the_first_panel():
    times = np.arange(4.0)
    whole, early, late = np.arange(4.0), np.array([5.0, 6.0, 7.0, NAN]), np.full(4, 2.0)
    panels = {"a": np.stack([whole, early, late]), "b": np.tile(FLAT, (3, 2))}
    panels |= {"c": np.full((3, 4), NAN)}
    labels = ("nominal", "flight 7", "flight 2")
    figure = plot_flights(times, panels, labels, "title", limits=(4.0,))
    first, second, third = figure.axes[:3]
    np.testing.assert_equal(lines(first), [
        ("nominal", np.column_stack([times, whole]).tolist()),
        ("flight 7", np.column_stack([times, early]).tolist()),
        ("", [[2.0, 7.0]]),
        ("flight 2", np.column_stack([times, late]).tolist()),
        across(4.0),
    ])  # fmt: skip
    cross, flown = first.lines[2], first.lines[1]
    assert (cross.get_marker(), cross.get_color()) == ("x", flown.get_color())
    assert [label for label, _ in lines(second)] == [label for label, _ in lines(third)]
    assert [label for label, _ in lines(second)] == list(labels)
    assert second.get_ylim() == pytest.approx((2.0, 4.0)) and first.get_ylim()[1] > 6.0
    assert [axes.get_ylabel() for axes in figure.axes[:3]] == list("abc")
    assert [axes.get_xlabel() for axes in figure.axes[:3]] == ["", "time (s)", "time (s)"]
    styles = [line.get_linestyle() for line in (first.lines[0], flown, first.lines[3])]
    assert styles[0] != styles[1] == styles[2] == "-" and legend(figure) == [*labels, "limit"]
    assert len({line.get_color() for line in second.lines}) == 3
    assert figure.get_suptitle() == "title"
    assert len({axes.get_xlim() for axes in figure.axes[:3]}) == 1


@pytest.mark.parametrize("count", [1, 2])
def test_a_plan_has_a_panel_for_each_requirement_and_one_for_several(count):
    rates = np.array([0.0, 1.0, 3.0])
    entries = [
        SimpleNamespace(
            words=f"error < {k}",
            probability=0.9 + 0.05 * k,
            risk_used=0.1 + 0.1 * k,
            pass_chance=[
                SimpleNamespace(
                    runs=runs, at_some_flight=rates + runs + k, at_runs=rates - runs - k
                )
                for runs in (10, 20, 40)
            ],
        )
        for k in range(count)
    ]
    joint = [
        SimpleNamespace(at_some_flight=SimpleNamespace(low=rates + k, high=rates + 2.0 * k + 1.0))
        for k in range(3)
    ]
    planned = SimpleNamespace(rates_over_allowed=rates, requirements=entries, together=joint)
    figure = plot_planned(planned)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == (1 if count == 1 else 3)
    assert len({axes.get_ylim() for axes in shown}) == len({axes.get_xlim() for axes in shown}) == 1
    for k, axes in enumerate(shown[:count]):
        expected = []
        for n in (10, 20, 40):
            some, once = (
                np.column_stack([rates, y]).tolist() for y in (rates + n + k, rates - n - k)
            )
            expected += [(f"at some flight up to {n}", some), (f"at {n}", once)]
        expected += [across(0.1 + 0.1 * k, "consumer's risk"), upright(1.0)]
        assert lines(axes) == expected
        colors = [line.get_color() for line in axes.lines[:6]]
        assert colors[::2] == colors[1::2] and len(set(colors)) == 3
        (title,) = (text.get_text() for text in axes.texts if "error" in text.get_text())
        assert title == f"error < {k} in {90 + 5 * k} %"
        assert axes.yaxis.get_major_formatter()(0.5).startswith("50")
    if count == 2:
        for k, item in enumerate(shown[2].collections):
            assert band(item) == [[x, x + k, x + 2.0 * k + 1.0] for x in rates]
        assert lines(shown[2]) == [upright(1.0)] and len(shown[2].collections) == 3
    assert [bool(axes.get_ylabel()) for axes in shown] == [True, False, True][: len(shown)]
    assert [bool(axes.get_xlabel()) for axes in shown] == (
        [True] if count == 1 else [False, True, True]
    )
    assert len(legend(figure)) == 7
