"""The report's section on bands over time."""

from abhv_mc.topics.envelopes.curves import Curve, curves_of
from abhv_mc.topics.envelopes.model import Envelopes
from abhv_mc.topics.names import Names
from abhv_mc.topics.section import Cell, Fold, Item, Picture, Row, Section, Table, Text, Widget
from abhv_mc.topics.words import fixed


def envelope_section(found: Envelopes, names: Names) -> Section | None:
    """What bands are, the interactive ones, and the sheet of all channels; None where flights have no histories."""
    items: list[Item] = []
    campaign = found.source.campaign
    if not campaign.has_histories:
        return None
    if not campaign.has_bands:
        text = "None are kept; `keep: {envelopes: {rate: 5 Hz}}` in the campaign file asks for them."
        return Section("Bands over time", (Text(text),))
    if found.step_s is not None:
        flown = max(flights.flight.size for flights in found.source.flights.values())
        of = "" if found.flights >= flown else f" of flights 0 to {found.flights - 1}"
        who, ends = "flights still airborne", "at any control tick; the other bands are of samples"
        if campaign.user_model:
            who, ends = "flights that have a history then", "of all samples returned; the other bands are of values"
        apart = " s apart, linear between samples" if campaign.user_model else " s apart"
        items.append(
            Text(
                f"Bands are pointwise quantiles over the {who}{of}: no single flight need follow one. "
                f'"All flights" is the smallest and largest value {ends} {found.step_s:.4g}{apart}.'
            )
        )
        points = len(campaign.unknowns.points)
        if points > 1:
            items.append(
                Text(
                    f"The unknowns have one value for the whole programme: each band goes from the least to the most "
                    f"quantile over their {points} points, with {found.flights // points:,} flights at each, and the "
                    "median has two lines. Between them one cannot say where it lies; commands are drawn midway."
                )
            )
    of_paper = campaign.model.figures == "paper"
    rows = tuple(_row(found, names, curve, of_paper) for curve in curves_of(campaign))
    heads = ("Channel", *names.controllers.values(), *(["Figure", "The paper's single flight"] if of_paper else []))
    table = Table("Smallest and largest value of each channel", heads, (tuple(row for row in rows if row),))
    sheet = Fold("All channels on one sheet", (table, Picture("channels")))
    return Section("Bands over time", (*items, Widget("bands"), sheet))


def _row(found: Envelopes, names: Names, curve: Curve, of_paper: bool) -> Row:
    """A channel's range under each controller; nothing where no flight has it."""
    ranges = [found.ranges.get(name, {}).get(curve.channel) for name in names.controllers]
    if not any(ranges):
        return ()
    shown = [_ends(*ends) if ends else "" for ends in ranges]
    paper = [f"Fig. {curve.paper[0]}", curve.paper[1]] if of_paper and curve.paper else []
    label = curve.label.replace("altitude error", "altitude")
    return (Cell(label, head=True), *map(Cell, (*shown, *paper)))


def _ends(low: float, high: float) -> str:
    """Both ends of a range, to a thousandth of the range but no finer than four digits of the larger."""
    spread = high - low
    places = 2 if spread <= 0.0 else max(0, 2 - len(str(int(spread)))) if spread >= 1.0 else 3
    return f"{fixed(low, places)} to {fixed(high, places)}"
