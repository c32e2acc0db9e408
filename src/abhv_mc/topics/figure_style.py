"""Common style of figures: sizes, colours for colour-blind readers, and small files.

The background is transparent. On white, colours have a contrast ratio of at least 3 and text has a
contrast ratio of at least 12. Dark pages invert the lightness of figures (``style.css``),
which preserves or increases these ratios.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from io import BytesIO
from pathlib import Path
from string import ascii_lowercase
from textwrap import fill
from typing import Any, Literal, ParamSpec

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.style import context
from matplotlib.text import Annotation
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from abhv_mc.array_types import Floats
from abhv_mc.folder.layout import write_bytes

P = ParamSpec("P")

WIDTH = 7.2  # width of two journal columns in inches
DPI = 200
_MOST_STEPS = 2000  # maximum number of steps drawn in a distribution curve
# number of colours in the PNG palette, which reduces the file size to a third
_COLORS = 128
SMALLEST = 8.0  # size of all text in pt; figures are printed at the drawn width

# Okabe and Ito's palette (jfly.uni-koeln.de/color), in the order of the controllers.
# The last three colours are darker than in the original palette, to be legible on white.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#B5588C",
    "#B78000",
    "#3A93CE",
)
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
DASHES: tuple[Any, ...] = ("-", (0, (4, 1.5)), (0, (1.2, 1)), (0, (3, 1, 1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P")
INK = "#222222"
PERCENT = "\N{NARROW NO-BREAK SPACE}%"  # suffix of percentages in tick labels and in other text
GRID = "#80808050"
# Line styles that have the same meaning in all figures.
LIMIT: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (4, 2)), "zorder": 4.0}
REFERENCE: dict[str, Any] = {"color": INK, "linewidth": 0.6, "linestyle": "-"}
_LETTER = 0.0545  # mean width of a letter in inches
_LINE = 0.135  # height in inches of a line of text
_KEY = 3.2  # length of legend lines in font sizes: two periods of each line style are visible
_LETTER_ID = "panel letter"
_INDENT = 11.0  # distance in points between the letter and the title of a panel

_RC: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": SMALLEST,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titley": 1.0,  # A fixed title position saves matplotlib a slow search.
    "axes.labelsize": SMALLEST,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "text.color": INK,
    "grid.color": GRID,
    "grid.linewidth": 0.5,
    "xtick.labelsize": SMALLEST,
    "ytick.labelsize": SMALLEST,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": SMALLEST,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "figure.facecolor": "none",
}


def styled(plot: Callable[P, Figure]) -> Callable[P, Figure]:
    """Decorate a plot function to use the common style and to ignore global settings."""

    @wraps(plot)
    def draw(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with context(["default", _RC]):
            return plot(*args, **kwargs)

    return draw


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """Return an empty figure with a layout that avoids overlaps; sizes are in inches."""
    # The layout depends on the text size and thus on the resolution, so it is computed at
    # the resolution of the file.
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_panels(
    count: int,
    columns: int,
    row_height: float,
    *,
    between: tuple[float, float] = (0.68, 0.48),
    top: float = 0.24,
    left: float = 0.74,
    width: float = WIDTH,
    **shared: Any,
) -> tuple[Figure, Any]:
    """Return a figure with axes [row, column] for ``count`` panels; surplus axes are hidden.

    Sizes are in inches. ``row_height`` is the height of each axes, ``top`` is the space for titles,
    ``left`` is the space for labels, ``width`` is that of the figure, and ``between`` is the
    horizontal and vertical space between panels. The layout is fixed, because measuring text would
    take as long as drawing the figure. If there are several panels, each is labelled with a letter.
    ``shared`` is passed to :meth:`Figure.subplots`.
    """
    rows = -(-count // columns)
    bottom, right = 0.63, 0.12
    height = top + rows * row_height + (rows - 1) * between[1] + bottom
    panel = (width - left - right - (columns - 1) * between[0]) / columns
    figure = Figure(figsize=(width, height), dpi=DPI)
    FigureCanvasAgg(figure)
    layout = {
        "left": left / width,
        "right": 1.0 - right / width,
        "bottom": bottom / height,
        "top": 1.0 - top / height,
        "wspace": between[0] / panel,
        "hspace": between[1] / row_height,
    }
    grid = figure.subplots(rows, columns, squeeze=False, gridspec_kw=layout, **shared)
    for axes in grid.flat:
        for axis in (axes.xaxis, axes.yaxis):
            axis.get_major_locator().set_params(nbins=6)
        axes.xaxis.set_label_coords(0.5, -0.24 / row_height)
        axes.yaxis.set_label_coords(-0.55 / panel, 0.5)
    for axes in grid.flat[count:]:
        axes.set_visible(False)
    for letter, axes in zip(ascii_lowercase, grid.flat[:count] if count > 1 else (), strict=False):
        _put_above(axes, letter, 0.0, weight="bold", gid=_LETTER_ID)
    return figure, grid


def _put_above(axes: Axes, text: str, indent: float, **look: Any) -> Annotation:
    """Place text above the left end of axes, and return it; ``indent`` is in points."""
    return axes.annotate(
        text,
        (0.0, 1.0),
        xycoords="axes fraction",
        xytext=(indent - 1.0, 3.0),
        textcoords="offset points",
        **look,
    )


def title_panel(axes: Axes, title: str, **look: Any) -> None:
    """Put a panel's title next to the panel's letter; a long title is split into lines."""
    beyond = -0.3 if look else 0.0  # space in inches for the letter and for wide characters
    words = _put_above(axes, wrap(axes, title, beyond), _INDENT, linespacing=1.1, **look)
    for letter in axes.texts:
        if isinstance(letter, Annotation) and letter.get_gid() == _LETTER_ID:
            # The letter is aligned with the first line of the title.
            letter.xy, letter.xycoords, letter.xyann = (0.0, 1.0), words, (-_INDENT, 0.0)
            letter.set_verticalalignment("top")


def wrap(axes: Axes, text: str, beyond: float = 0.0) -> str:
    """Wrap text to the width of the axes plus ``beyond`` inches, without breaks inside a unit."""
    figure = axes.get_figure(root=True)
    width = axes.get_position().width * (figure.get_figwidth() if figure else WIDTH) + beyond
    whole = text.replace(" (", "\N{NO-BREAK SPACE}(")
    lines = fill(whole, int(width / _LETTER), break_on_hyphens=False)
    return lines.replace("\N{NO-BREAK SPACE}(", " (")


def label_lowest(grid: Any, count: int, label: str) -> None:
    """Set the x label under the lowest panel of each column."""
    for axes in grid.flat[max(0, count - grid.shape[1]) : count]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel(label)


def legend_below(figure: Figure, *panels: Axes, more: Iterable[tuple[str, Any]] = ()) -> None:
    """Add one legend below all panels; its first entries are the pairs in ``more``."""
    entries = dict(more) | {
        label: handle
        for axes in panels
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    put_legend(figure, list(entries.values()), list(entries.keys()))


def put_legend(figure: Figure, handles: Sequence[Any], labels: Sequence[str]) -> None:
    """Add a legend at the lower edge, in several rows if it is wider than the figure."""
    length = sum(0.26 + _KEY * SMALLEST / 72.0 + _LETTER * len(label) for label in labels)
    rows = max(1, -(-int(100.0 * length) // int(100.0 * WIDTH)))
    columns = max(1, -(-len(labels) // rows))
    # matplotlib fills legends column by column, but people read them row by row.
    order = [i for column in range(columns) for i in range(column, len(labels), columns)]
    if not figure.get_layout_engine():
        _make_room(figure, 0.17 * (rows - 1))
    figure.legend(
        [handles[i] for i in order],
        [labels[i] for i in order],
        loc="outside lower center" if figure.get_layout_engine() else "lower center",
        ncols=columns,
        borderaxespad=0.2,
        handlelength=_KEY,
        columnspacing=1.8 if length < 0.8 * rows * WIDTH else 1.0,
    )


def _make_room(figure: Figure, below: float) -> None:
    """Move rows of panels apart to make space for titles and labels of several lines.

    The panels keep their sizes; ``below`` is additional space in inches at the lower edge.
    """
    rows: dict[int, list[Axes]] = {}
    for axes in figure.axes:
        if (place := axes.get_subplotspec()) is not None:
            rows.setdefault(place.rowspan.start, []).append(axes)
    lift, lifts = below, {}
    for row in sorted(rows, reverse=True):
        lift += _LINE * max(axes.get_xlabel().count("\n") for axes in rows[row])
        lifts[row] = lift
        titles = (text.get_text() for axes in rows[row] for text in axes.texts)
        lift += _LINE * max((title.count("\n") for title in titles), default=0)
    old, new = figure.get_figheight(), figure.get_figheight() + lift
    figure.set_figheight(new)
    for row, panels in rows.items():
        for axes in panels:
            left, bottom, width, height = axes.get_position().bounds
            axes.set_position((left, (bottom * old + lifts[row]) / new, width, height * old / new))


def controller_colors(names: Iterable[str]) -> dict[str, str]:
    """Return a colour for each controller, chosen by its position in the campaign."""
    return {name: CYCLE[i % len(CYCLE)] for i, name in enumerate(names)}


def line_look(number: int, count: int) -> dict[str, Any]:
    """Return the look of a controller's line by its position among ``count`` controllers.

    The first controller is drawn last, as a solid line. The
    other lines are wider, paler and dashed, so that they remain visible if all lines coincide.
    """
    return {
        "color": CYCLE[number % len(CYCLE)],
        "linestyle": DASHES[number % len(DASHES)],
        "linewidth": 1.2 if number == 0 else 1.9,
        "alpha": 1.0 if number == 0 else 0.7,
        "zorder": 3.0 - number / count,
    }


def mark_look(number: int, count: int, size: float) -> dict[str, Any]:
    """Return the look of a controller's marks; the first controller has small marks on top."""
    return {
        "marker": MARKERS[number % len(MARKERS)],
        "markersize": size * (1.6 + 0.1 * number if number else 1.0),
        "zorder": 3.0 - number / count,
    }


def label_shares(grid: Any) -> None:
    """Scale and label the shared y axes of panels that show cumulative shares of flights."""
    for axes in grid.flat:
        axes.set_ylim(-0.02, 1.02)
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, symbol=PERCENT))
    for axes in grid[:, 0]:
        axes.set_ylabel("share of flights")


def pad_if_flat(axes: Axes) -> None:
    """Widen the y limits of a constant curve, so that rounding errors do not look like noise."""
    low, high = axes.get_ylim()
    if high - low < 1e-9:
        axes.set_ylim((low + high) / 2.0 - 1.0, (low + high) / 2.0 + 1.0)


def distribution_steps(values: Floats) -> tuple[Floats, Floats]:
    """Return the finite values in ascending order, and the cumulative share at each value.

    At most ``_MOST_STEPS`` points are returned.
    """
    ascending = np.sort(values)
    share = np.arange(1, ascending.size + 1) / max(ascending.size, 1)
    keep = np.unique(
        np.linspace(0, ascending.size - 1, min(ascending.size, _MOST_STEPS)).astype(int)
    )
    keep = keep[np.isfinite(ascending[keep])]
    return ascending[keep], share[keep]


def write_png(figure: Figure, path: Path) -> tuple[int, int]:
    """Write a figure at print resolution; return width and height in px.

    Raise StorageFullError or InputError.
    """
    from PIL import Image

    canvas = FigureCanvasAgg(figure)
    with context(["default", _RC]):
        canvas.draw()
    image = Image.fromarray(np.asarray(canvas.buffer_rgba()))
    file = BytesIO()
    image.quantize(_COLORS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
        file, format="PNG", compress_level=6, dpi=(DPI, DPI)
    )
    write_bytes(path, file.getvalue())
    return image.width, image.height


def write_svg(figure: Figure, path: Path) -> None:
    """Write a figure as reproducible SVG, with text stored as text.

    Raise the same errors as :func:`write_png`.
    """
    file = BytesIO()
    with context(["default", _RC, {"svg.hashsalt": "abhv-mc", "svg.fonttype": "none"}]):
        FigureCanvasSVG(figure).print_svg(file, metadata={"Date": None, "Creator": None})
    write_bytes(path, file.getvalue())


LOG_AXIS = "log\N{NO-BREAK SPACE}axis"  # text added to the label of a logarithmic axis


def log_if_wide(axes: Axes, way: Literal["x", "y"], values: Sequence[Floats]) -> bool:
    """Make an axis logarithmic if all but the smallest values span more than a factor of 20."""
    finite = np.concatenate([v[np.isfinite(v)] for v in values])
    if not finite.size or finite.min() <= 0.0:
        return False
    low, high = float(np.quantile(finite, 0.02)), float(finite.max())
    if high <= 20.0 * low:
        return False
    axis = getattr(axes, f"{way}axis")
    axes.set(**{f"{way}scale": "log"})
    subs = (1.0, 2.0, 5.0) if high < 50.0 * low else (1.0, 3.0) if high < 500.0 * low else (1.0,)
    axis.set_major_locator(LogLocator(base=10.0, subs=subs, numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
    return True


def draw_limits(
    axes: Axes, way: Literal["x", "y"], limits: Sequence[float], unit: str
) -> list[str]:
    """Draw the limits near the range of an axis; return notes on the limits not drawn."""
    notes, scale = [], getattr(axes, f"{way}axis").get_transform()
    for limit in limits:
        ends = getattr(axes, f"get_{way}lim")()
        # Distances are compared on the scale of the axis, which may be logarithmic.
        low, high, position = scale.transform(np.array([*ends, limit]))
        if low - 0.5 * (high - low) <= position <= high + 0.5 * (high - low):
            (axes.axvline if way == "x" else axes.axhline)(limit, label="limit", **LIMIT)
            room = 0.03 * (high - low)
            wide = np.array([min(low, position - room), max(high, position + room)])
            axes.set(**{f"{way}lim": scale.inverted().transform(wide)})
        else:
            sides = ("left", "right") if way == "x" else ("down", "up")
            words = ["limit", f"{limit:g}", unit, "further", sides[int(limit > ends[1])]]
            notes.append("\N{NO-BREAK SPACE}".join(filter(None, words)))
    return notes


def make_value_axis(
    axes: Axes,
    label: str,
    values: Sequence[Floats],
    *,
    limits: Sequence[float] = (),
    unit: str = "",
    beyond: float = 0.0,
) -> None:
    """Scale and label the x axis of a metric, and draw the limits of requirements.

    The axis is extended to limits that are close to its ends; the label names the other limits.
    ``beyond`` is the space in inches by which the label may be wider than the axis.
    """
    notes = []
    if log_if_wide(axes, "x", values):
        notes.append(LOG_AXIS)
        finite = np.concatenate([v[np.isfinite(v)] for v in values])
        # Rare values close to zero would compress the other values.
        lowest = 0.05 * float(np.quantile(finite, 0.02))
        if finite.min() < lowest:
            axes.set_xlim(left=lowest)
    notes += draw_limits(axes, "x", limits, unit)
    axes.set_xlabel(wrap(axes, ", ".join([label, *notes]), beyond))
