"""Curves, limits and labels of figures."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from abhv_mc.flights.metrics import MARGINS
from abhv_mc.flights.statistic import Statistic
from abhv_mc.folder.flown_campaign import BANDS
from abhv_mc.topics.comparison import COMPARISON
from abhv_mc.topics.comparison.figures import (
    DifferencePanel,
    plot_differences,
    plot_error_against_usage,
    plot_variants,
)
from abhv_mc.topics.comparison.model import total_usage
from abhv_mc.topics.envelopes import ENVELOPES
from abhv_mc.topics.figure_bands import (
    EnvelopePanel,
    EnvelopeRow,
    plot_envelopes,
    plot_errors,
    plot_sheet,
)
from abhv_mc.topics.figure_style import BLUE, CYCLE
from abhv_mc.topics.flights import FLIGHTS
from abhv_mc.topics.flights.figures import _limit_curves
from abhv_mc.topics.flights.model import channel_of
from abhv_mc.topics.metrics.figures import Spread, make_spread, plot_distributions
from abhv_mc.topics.topic import Models
from abhv_mc_vehicle.flight.metrics import METRICS


@pytest.fixture
def panel():
    x = np.linspace(0.0, 10.0, 50)
    return EnvelopePanel(x, {name: np.sin(x) + 0.1 * i for i, name in enumerate(BANDS)})


def test_bands_are_drawn_where_they_say(panel):
    figure = plot_envelopes([EnvelopeRow("y", [panel])], ["A"], [BLUE])
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sorted(labels) == ["0.135–99.865 %", "5–95 %", "all flights", "median"]
    areas = figure.axes[0].collections
    for area, (low, high) in zip(
        areas, [("min", "max"), ("q0.135", "q99.865"), ("q5", "q95")], strict=True
    ):
        corners = area.get_paths()[0].vertices[:, 1]
        assert corners.min() == pytest.approx(panel.bands[low].min())
        assert corners.max() == pytest.approx(panel.bands[high].max())


def test_with_unknowns_the_median_has_two_lines(panel):
    panel = replace(panel, bands={**panel.bands, "q50_most": panel.bands["q50"] + 0.2})
    figure = plot_envelopes([EnvelopeRow("y", [panel])], ["A"], [BLUE])
    lines = figure.axes[0].lines
    assert np.allclose(lines[1].get_ydata() - lines[0].get_ydata(), 0.2)
    assert figure.legends[0].get_texts()[0].get_text() == "least and most median"


def test_altitude_errors_are_in_metres_and_a_moving_reference_is_not_the_flights_spread(failing):
    """A band spans the ticks of a tenth of a second, in which the reference itself moves 15 m."""
    figures = {
        text.name: figure
        for topic in (ENVELOPES, FLIGHTS)
        for text, figure in Models(failing).figures(topic)
    }
    (altitude,) = (
        axes
        for axes in figures["channels"].axes
        if "altitude error (m)" in [text.get_text() for text in axes.texts]
    )
    assert figures["worst_flights"].axes[0].get_ylabel() == "speed error (m/s)"  # what they miss
    low, high = altitude.get_ylim()
    assert -40.0 < low < 0.0 < high < 40.0
    track = figures["channels"].axes[0]
    # two bands of the first controller, and four edges of those of the other
    edges = [
        [
            line
            for line in axes.lines
            if line.get_color() == CYCLE[1] and line.get_linewidth() == 0.6
        ]
        for axes in (track, altitude)
    ]
    assert len(track.collections) == len(altitude.collections) == 2
    assert len(edges[0]) == len(edges[1]) == 4


def test_a_limit_beyond_the_axis_is_named_with_its_unit():
    spread = Spread("Error (m)", {"a": np.arange(1.0, 9.0)}, (9.0, 50.0), "m")
    axes = plot_distributions([spread], {"a": "A"}, {"a": BLUE}).axes[0]
    assert axes.get_xlabel().split() == ["Error", "(m),", "limit", "50", "m", "further", "right"]
    (limit,) = (line for line in axes.lines if line.get_label() == "limit")
    assert limit.get_xdata()[0] == 9.0


def test_small_values_on_a_logarithmic_axis_are_visible():
    """Regression: the axis began at half of the 2 % quantile, which cut the curve off."""
    values = np.append(np.geomspace(10.0, 1000.0, 200), 1.0)
    axes = plot_distributions([Spread("x", {"a": values})], {"a": "A"}, {"a": BLUE}).axes[0]
    assert axes.get_xscale() == "log" and axes.get_xlim()[0] < 1.0


@pytest.mark.parametrize(("limit", "notes"), [(1.3, 0), (5.0, 1)])
def test_the_limit_of_a_metric_against_control_effort_is_drawn_or_noted(limit, notes):
    """Regression: a limit somewhat above the flights was drawn outside the axis."""
    values = np.linspace(0.5, 1.0, 600)
    trade = Spread("Error (m)", {"tlc": values, "lqr": values}, (limit,), "m")
    usage = {"tlc": values, "lqr": values}
    figure = plot_error_against_usage(
        usage, [trade], "effort", {"tlc": "TLC", "lqr": "LQR"}, {"tlc": "b", "lqr": "r"}
    )
    axes = figure.axes[0]
    lines = [line for line in axes.lines if line.get_label() == "limit"]
    assert len(lines) == 1 - notes
    assert all(axes.get_ylim()[0] == 0.0 < limit < axes.get_ylim()[1] for _ in lines)
    assert sum("5" in text.get_text() for text in axes.texts) == notes
    flights = [line for line in axes.lines if len(line.get_xdata()) > 2]
    assert all(100 < len(line.get_xdata()) <= 250 for line in flights)


@pytest.mark.parametrize(("limit", "drawn"), [(0.008, 1), (0.5, 1), (40.0, 1), (1e4, 0), (-1.0, 0)])
def test_limits_of_a_logarithmic_axis_lie_inside_it(limit, drawn):
    """Regression: the lower end of a logarithmic axis was set to a negative value."""
    values = np.geomspace(0.02, 10.0, 300)
    trade = Spread("Error (m)", {"tlc": values}, (limit,), "m")
    figure = plot_error_against_usage({"tlc": values}, [trade], "e", {"tlc": "TLC"}, {"tlc": "b"})
    (axes, *_) = figure.axes
    assert axes.get_yscale() == "log" and sum(x.get_label() == "limit" for x in axes.lines) == drawn
    low, high = axes.get_ylim()
    assert 0.0 < low < 0.021 and high > 9.9
    assert not drawn or low < limit < high


def test_limits_are_drawn_when_they_apply_and_transients_are_shaded(panel, failing):
    """Regression: limits spanned transients, in which a flight seemed to violate them."""
    level = np.where(panel.x < 5.0, np.nan, 0.5)
    panel = replace(panel, flights=[(panel.x, panel.bands["q50"])], limits=[(panel.x, level)])
    figure = plot_envelopes([EnvelopeRow("y", [panel])], ["A"], [BLUE])
    sheet = plot_sheet([EnvelopeRow("y", [panel])], ["A"])
    for drawn in (figure, sheet):
        texts = [text.get_text() for legend in drawn.legends for text in legend.get_texts()]
        assert texts.count("limit") == 1
    free = replace(panel, limits=())
    beside = plot_envelopes([EnvelopeRow("y", [panel]), EnvelopeRow("z", [free])], ["A"], [BLUE])
    texts = [text.get_text() for text in beside.legends[0].get_texts()]
    assert texts.count("limit") == texts.count("worst flight") == 1
    shade = figure.axes[0].collections[-1].get_paths()[0].vertices
    assert shade[:, 0].min() == 0.0 and 4.7 < shade[:, 0].max() < 5.0
    assert np.array_equal(figure.axes[0].lines[-1].get_ydata(), level, equal_nan=True)
    everywhere = replace(panel, limits=[*panel.limits, (panel.x, np.ones(panel.x.size))])
    assert everywhere.excluded is None
    plain = plot_envelopes([EnvelopeRow("y", [everywhere])], ["A"], [BLUE])
    labels, others = (
        {text.get_text() for text in item.legends[0].get_texts()} for item in (figure, plain)
    )
    assert others < labels  # one names the shade
    (first, end), *_ = failing.campaign.transients
    assert first == 0.0 and end > 5.0


def test_a_margin_has_no_channel():
    """Regression: a channel without unit, such as `mach`, was that of any metric."""
    channels = {"mach", "bank_deg"}
    metrics = {metric.name: metric for metric in METRICS}
    stems = {"bank_deg": "bank"}
    assert channel_of(MARGINS[0], channels, stems) is None
    assert channel_of(metrics["bank_error_settled_max_deg"], channels, stems) == "bank_deg"


def test_failed_flights_keep_the_curve_from_100_percent():
    values = np.array([1.0, 2.0, 3.0, np.inf])
    figure = plot_distributions([Spread("x", {"a": values})], {"a": "A"}, {"a": BLUE})
    assert figure.axes[0].lines[0].get_ydata().max() == 0.75


def test_limits_have_gaps_where_a_requirement_does_not_apply():
    """A settled metric from 1 to 9 s, with transients from 2 to 4 s and from 8 s on."""
    metric = SimpleNamespace(
        of="bank_deg", statistic=Statistic.MAX_ABS, start=1.0, end=9.0, settled=True
    )
    names = SimpleNamespace(
        metrics={"m": metric},
        results=SimpleNamespace(reference={"time": np.arange(11.0)}),
        campaign=SimpleNamespace(transients=[(2.0, 4.0), (8.0, 20.0)], limits_of=lambda _: (3.0,)),
    )
    low, high = _limit_curves("m", names)
    applies = np.isin(np.arange(11), [1, 4, 5, 6, 7])
    np.testing.assert_array_equal(low[1], np.where(applies, -3.0, np.nan))
    np.testing.assert_array_equal(high[1], np.where(applies, 3.0, np.nan))
    metric.settled, metric.statistic = False, Statistic.MIN
    ((time, level),) = _limit_curves("m", names)
    np.testing.assert_array_equal(level, np.where((time >= 1) & (time <= 9), 3.0, np.nan))
    names.results.reference = {}
    assert [own.tolist() for own in _limit_curves("m", names)[0]] == [[1.0, 9.0], [3.0, 3.0]]


def test_an_inset_enlarges_the_largest_change_of_any_band():
    x = np.linspace(0.0, 60.0, 601)
    bands = {name: np.zeros(601) for name in (*BANDS, "q50")}
    bands["max"] = 9.0 * np.exp(-((x - 40.0) ** 2))
    bands["q95"] = np.exp(-((x - 10.0) ** 2))
    figure = plot_sheet([EnvelopeRow("y", [EnvelopePanel(x, bands)], inset=True)], ["A"])
    (inset,) = figure.axes[0].child_axes
    low, high = inset.get_xlim()
    assert low < 40.0 < high and (low + high) / 2.0 == pytest.approx(40.0, abs=0.2)
    bottom, top = inset.get_ylim()
    assert bottom < 0.0 and 9.0 < top < 10.0


def texts_of(axes):
    return [text.get_text().replace("\n", " ") for text in axes.texts]


def test_variants_are_cells_of_their_two_values():
    """Of a limit above, the 5 % quantile is the worse."""
    values = [("1", "10 ms"), ("2", "10 ms"), ("3", "10 ms"), ("1", "20 ms"), ("3", "20 ms")]
    variants = {f"v{k}": ("tlc", "gain", x, "lag", y) for k, (x, y) in enumerate(values)}

    def row(below, statuses):
        cells = {
            name: SimpleNamespace(low=-1.0 - k, high=10.0 * (k + 1), status=status)
            for k, (name, status) in enumerate(zip(variants, statuses, strict=True))
        }
        return SimpleNamespace(label="Error", text="< 7 m", unit="m", below=below, cells=cells)

    rows = [row(True, ["PASS", "PASS", "FAIL", "", "PASS"]), row(False, [""] * 5)]
    high, low = plot_variants(variants, rows).axes
    nan = np.nan
    for axes, values in (
        (high, [[10, 20, 30], [40, nan, 50]]),
        (low, [[-1, -2, -3], [-4, nan, -5]]),
    ):
        cells = axes.collections[0].get_array()
        np.testing.assert_array_equal(np.ma.filled(cells, nan), values)
        assert [label.get_text() for label in axes.get_xticklabels()] == ["1", "2", "3"]
        assert [label.get_text() for label in axes.get_yticklabels()] == ["10 ms", "20 ms"]
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("gain", "lag")
        places = [text.get_position() for text in axes.texts[1:6]]
        assert places == [(0, 0), (1, 0), (2, 0), (0, 1), (2, 1)]
    assert texts_of(high)[1:6] == ["10.0 PASS", "20.0 PASS", "30.0 FAIL", "40.0 ", "50.0 PASS"]
    assert texts_of(low)[1:4] == ["−1.00 ", "−2.00 ", "−3.00 "]
    assert (texts_of(high)[6], texts_of(low)[6]) == ("Error < 7 m", "Error (m)")
    assert high.collections[0].get_clim()[0] == 0.0 and low.collections[0].get_clim()[0] == -5.0


@pytest.mark.parametrize(
    ("bases", "keys", "drawn"), [("aaa", "xxx", True), ("aba", "xxx", False), ("aaa", "xyx", False)]
)
def test_variants_of_one_base_and_two_entries_are_drawn(failing, monkeypatch, bases, keys, drawn):
    monkeypatch.setattr("abhv_mc.topics.comparison.figures.plot_variants", lambda found, _: found)
    names = Models(failing).names
    variants = [
        f"{base}+{key}={k}+lag={2 * k} ms"
        for k, (base, key) in enumerate(zip(bases, keys, strict=True))
    ]
    flights = dict(zip(variants, failing.flights.values(), strict=True))
    results = replace(failing, flights={**failing.flights, **flights})
    names = replace(names, results=results, controllers={name: name for name in variants})
    figures = {text.name: figure for text, figure in COMPARISON.figures(None, names)}
    assert list(figures) == ["variants"] * drawn + ["error_against_usage"]
    if drawn:
        assert figures["variants"][variants[2]] == ("a", "x", "2", "lag", "4 ms")


@pytest.mark.parametrize("required", [True, False])
def test_errors_against_control_effort_are_of_completed_flights(failing, required):
    """TLC completes all 100 flights, and the others 88."""
    names = Models(failing).names
    drawn = [*names.asked]
    if not required:
        drawn = ["altitude_error_max_m", "sideslip_max_deg"]
        campaign = replace(failing.campaign, requirements=())
        results = replace(failing, campaign=campaign)
        asked = (drawn[0], "rudder_rms_deg", drawn[1])
        names = replace(names, asked=asked, requirements=(), results=results)
    ((_, figure),) = COMPARISON.figures(None, names)
    panels = [axes for axes in figure.axes if axes.get_visible()]
    for axes, metric in zip(panels, drawn, strict=True):
        title = " ".join(texts_of(axes)).replace("\xa0", " ")
        assert names.metrics[metric].label_with_unit in title
        limits = {line.get_ydata()[0] for line in axes.lines if line.get_label() == "limit"}
        limits |= {float(text) for text in re.findall(r"limit (\S+) (?:m|deg)", title)}
        assert limits == set(failing.campaign.limits_of(metric) if required else ())
        clouds = [line for line in axes.lines if len(line.get_xdata()) > 2]
        for name, cloud in zip(names.controllers, clouds, strict=True):
            flights = failing.flights[name]
            done = ~flights.failed
            x, y = total_usage(flights)[done], flights.metrics[metric][done]
            assert np.array_equal(cloud.get_xydata(), np.stack([x, y], axis=1))
            (mark,) = (line for line in axes.lines if line.get_label() == names.label(name))
            assert mark.get_xydata().tolist() == [[np.median(x), np.median(y)]]
    assert len({axes.get_xlim() for axes in panels}) == 1


def test_few_of_many_flights_are_drawn_with_the_two_extremes():
    values = np.random.default_rng(3).permutation(np.arange(1.0, 602.0))
    values[5] = np.nan
    trade = Spread("Error (m)", {"a": values, "b": np.full(3, np.nan)})
    usage = {"a": 2.0 * values, "b": np.ones(3)}
    figure = plot_error_against_usage(
        usage, [trade], "e", {"a": "A", "b": "B"}, {"a": "b", "b": "r"}
    )
    cloud, median = figure.axes[0].lines
    x, y = cloud.get_xydata().T
    assert 200 <= y.size <= 252 and {y.min(), y.max()} == {np.nanmin(values), np.nanmax(values)}
    assert x.tolist() == (2.0 * y).tolist()
    assert median.get_xydata().tolist() == [[2.0 * np.nanmedian(values), np.nanmedian(values)]]


def test_differences_are_cumulative_with_their_medians_and_intervals():
    values = np.r_[np.arange(-2.0, 8.0), np.inf, -np.inf]
    panels = [
        DifferencePanel(
            "E (m)", {"p": values, "q": -values}, {"p": (2.0, 1.0, 4.0), "q": (-2.0, None, -1.0)}
        ),
        DifferencePanel("F (m)", {"p": np.full(3, np.inf)}, {"p": (None, None, None)}),
    ]
    figure = plot_differences(panels, {"p": "P", "q": "Q"}, {"p": BLUE, "q": CYCLE[1]}, "equal")
    first, second = figure.axes
    curves = {line.get_label(): line.get_xydata() for line in first.lines}
    finite = np.sort(values)[1:-1]
    shares = np.arange(2, 12) / 12.0
    assert curves["P"] == pytest.approx(np.stack([finite, shares], axis=1))
    assert curves["Q"] == pytest.approx(np.stack([-finite[::-1], shares], axis=1))
    assert curves["equal"][:, 0].tolist() == [0.0, 0.0]
    marks, arms = zip(*((bar.lines[0], bar.lines[2][0]) for bar in first.containers), strict=True)
    assert [mark.get_xydata().tolist() for mark in marks] == [[[2.0, 0.5]], [[-2.0, 0.5]]]
    ends = [arm.get_segments()[0][:, 0].tolist() for arm in arms]
    assert ends == [[1.0, 4.0], [-2.0, -1.0]]
    low, high = first.get_xlim()
    least, most = np.quantile(finite, [0.005, 0.995])
    reach = max(most, -least)
    assert (low, high) == pytest.approx((-1.12 * reach, 1.12 * reach))
    assert second.get_xlim() == pytest.approx((-0.06, 0.06)) and not second.containers
    assert (first.get_xlabel(), second.get_xlabel()) == ("E (m)", "F (m)")


def test_an_inset_is_where_any_controller_changes_most():
    """The smaller change of the first controller is at another time; short flights have none."""
    x = np.linspace(0.0, 60.0, 601)

    def panel(time, center, size):
        bump = size * np.exp(-((time - center) ** 2))
        return EnvelopePanel(
            time, {"q50": 5.0 + 0.0 * time, "min": 5.0 - bump, "max": 5.0 + 0.0 * time}
        )

    row = EnvelopeRow("y", [panel(x, 10.0, 2.0), panel(x, 40.0, 3.0)], inset=True)
    (inset,) = plot_sheet([row], ["A", "B"]).axes[0].child_axes
    assert np.mean(inset.get_xlim()) == pytest.approx(40.0, abs=0.2)
    early = EnvelopeRow("y", [panel(x, 1.0, 2.0)], inset=True)
    assert plot_sheet([early], ["A"]).axes[0].child_axes[0].get_xlim() == (0.0, 6.0)
    short = EnvelopeRow("y", [panel(x[:110], 10.0, 2.0)], inset=True)
    assert plot_sheet([short], ["A"]).axes[0].child_axes == []
    plain = EnvelopeRow("y", [panel(x, 10.0, 2.0)])
    assert plot_sheet([plain], ["A"]).axes[0].child_axes == []


def test_axes_span_the_values_shown_with_a_margin():
    x = np.linspace(0.0, 10.0, 11)
    panel = EnvelopePanel(
        x,
        {"q50": np.full(11, np.nan)},
        reference=(x, 0.1 * x - 3.0),
        flights=[(x, np.where(x > 8.0, np.inf, 4.0))],
        limits=[(x, np.full(11, 7.0))],
    )
    figure = plot_envelopes([EnvelopeRow("y", [panel])], ["A"], [BLUE])
    axes = figure.axes[0]
    assert axes.get_xlim() == (0.0, 10.0)
    assert axes.get_ylim() == pytest.approx((-3.0 - 0.6, 7.0 + 0.6))
    flat = EnvelopePanel(x, {"q50": np.full(11, 5.0)})
    axes = plot_envelopes([EnvelopeRow("y", [flat])], ["A"], [BLUE]).axes[0]
    assert axes.get_ylim() == pytest.approx((5.0 - 5e-3, 5.0 + 5e-3))
    nothing = EnvelopePanel(np.full(2, np.nan), {"q50": np.full(2, np.nan)})
    axes = plot_envelopes([EnvelopeRow("y", [nothing])], ["A"], [BLUE]).axes[0]
    assert np.isfinite([*axes.get_xlim(), *axes.get_ylim()]).all()


def test_errors_have_their_limits_and_only_the_worst_flight():
    x = np.linspace(0.0, 5.0, 6)
    panel = EnvelopePanel(x, {}, flights=[(x, x**2)], limits=[(x, np.full(6, 30.0))])
    figure = plot_errors([("T", "Error (m)", BLUE, panel)])
    (axes,) = figure.axes
    assert [line.get_ydata().tolist() for line in axes.lines] == [(x**2).tolist(), [30.0] * 6]
    assert axes.get_xlim() == (0.0, 5.0) and axes.get_ylim() == pytest.approx((-1.8, 31.8))
    assert axes.get_ylabel() == "Error (m)" and axes.get_xlabel() == "time (s)"


@pytest.mark.parametrize("bad", ["high", "low"])
def test_flights_that_end_early_are_beyond_the_bad_end_of_a_distribution(failing, bad):
    metric = "sideslip_max_deg"
    record = replace(failing.campaign.metrics[metric], bad=bad)
    campaign = SimpleNamespace(metrics={metric: record}, limits_of=lambda _: [0.7])
    spread = make_spread(campaign, metric, failing.flights)
    assert (spread.label, spread.unit, spread.limits) == ("Sideslip, max (deg)", "deg", [0.7])
    lqr = failing.flights["lqr"]
    assert lqr.failed.sum() == 12
    end = np.inf if bad == "high" else -np.inf
    expected = np.where(lqr.failed, end, lqr.metrics[metric])
    assert spread.values["lqr"].tolist() == expected.tolist()
    curves = plot_distributions(
        [spread], dict.fromkeys(spread.values, "x"), dict.fromkeys(spread.values, BLUE)
    )
    shares = curves.axes[0].lines[1].get_ydata()
    ends = (1 / 100, 88 / 100) if bad == "high" else (13 / 100, 1.0)
    assert (shares.min(), shares.max()) == pytest.approx(ends)


def test_dashed_lines_are_those_named():
    names = {"a": "A", "b": "B"}
    spread = Spread("x", dict.fromkeys(names, np.arange(3.0)))
    colors = dict.fromkeys(names, BLUE)
    (axes,) = plot_distributions([spread], names, colors, ("b",)).axes[:1]
    assert [line.get_linestyle() for line in axes.lines] == ["-", "--"]
