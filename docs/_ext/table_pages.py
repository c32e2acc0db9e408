"""Pages from the code's tables: metrics, channels, parameters, outcomes, exit codes, units."""

from collections.abc import Iterable

from tables import code, table

from abhv_mc.cli.errors import ExitCode
from abhv_mc.flights.metrics import MARGIN_VALUES
from abhv_mc.flights.outcomes import SENTENCES, Outcome
from abhv_mc.flights.signals import Signal
from abhv_mc.io.units import DIMENSIONS
from abhv_mc_vehicle.flight.channels import CHANNELS, REFERENCE_CHANNELS, SOURCES
from abhv_mc_vehicle.flight.metrics import METRICS
from abhv_mc_vehicle.plant.parameters import PARAMETERS

_EXIT_CODES = {
    ExitCode.DONE: "done",
    ExitCode.FAILED: "done, but a verification failed or a requirement got FAIL for a controller "
    "under test (`under_test:`, or the requirement's `controllers:`)",
    ExitCode.BAD_INPUT: "bad input: the message gives file, line, column, the value found and "
    "the value expected. No "
    "files are created, and no flight is run",
    ExitCode.INCOMPLETE: "interrupted or incomplete, or some flights failed to run. Completed "
    "flights are kept; the "
    "same command resumes",
    ExitCode.DEFECT: "a defect of the program, with a traceback; please report it",
}


def _signals(signals: Iterable[Signal]) -> str:
    return table(("name", "unit", "meaning"), ((code(s.name), s.unit, s.doc) for s in signals))


def _metrics() -> str:
    rows = (
        (code(m.name), m.unit, m.doc, f"{m.statistic.word} of {code(m.of)}", m.bad, m.group)
        for m in METRICS
    )
    others = [source for source in SOURCES.values() if source not in CHANNELS]
    return f"""# Metrics

Each metric is a column of `flights/*.parquet`; requirements, `keep.histories.by` and the report use
the same names. Metrics are evaluated at every control tick, from the start to the end of the
flight. If a flight terminated early, its metrics cover the time up to the termination. The outcome
states the reason, and the flight counts as a failure unless the requirement sets
`ended_early: as_measured`. Errors of
angle of attack and bank refer to the controller's own command.

{table(("name", "unit", "meaning", "counted as", "bad", "group"), rows)}
`abhv-mc list metrics` prints the same table, and with a campaign file also the metrics that the
file declares.

Besides the channels, metrics may use these sources:

{_signals(others)}
## Stability margins

Margins are computed if the campaign has the key `margins`, for the stated number of flights. They
are 0 if the loop is unstable, or if the flight ended before the time of the margins.

{_signals(MARGIN_VALUES)}
## Custom metrics

[Custom metrics](../user-laws.md#custom-metrics) are declared in the campaign and used like the
built-in ones.
"""


def _channels() -> str:
    return f"""# Channels

Histories, envelopes and replays record the following quantities. Commands have `_command` before
the unit. The heat flux is not-a-number if the vehicle file has no `reference.nose_radius`.

These channels are circular: {", ".join(code(s.name) for s in CHANNELS if s.circular)}. Histories
contain them as recorded, and metrics use these values. For envelopes and simultaneous bands, values
at each time move by full turns to within half a turn of the circular mean of the flights, which is
continuous over time. No band exists where the resultant length of the flights' directions is below
0.6. The minimum and maximum cover the stored flights at the recorded times.

{_signals(CHANNELS)}
## Reference channels

The file `reference.parquet` has the reference of the mission, which is the same for every flight of
a campaign.

{_signals(REFERENCE_CHANNELS)}"""


def _parameters() -> str:
    parts = [
        "# Parameters\n",
        "A campaign can disperse these parameters under `dispersions:`. A factor multiplies "
        "(nominal 1); an error is",
        "added in its unit (nominal 0). Nominal values do not change the flight. Dispersions "
        "act on the plant;",
        "controllers use the nominal model. `abhv-mc list parameters` prints this table. In a "
        "campaign the names",
        "of the vehicle file replace `effector_0` to `effector_3`: "
        "`failure.right_elevon.stuck_time`.\n",
    ]
    groups: dict[str, list[tuple[str, ...]]] = {}
    for parameter in PARAMETERS:
        if "." in parameter.name:
            row = (code(parameter.name), parameter.unit, f"{parameter.nominal:g}", parameter.doc)
            groups.setdefault(parameter.name.split(".")[0], []).append(row)
    for name, rows in groups.items():
        parts += [f"## {name}\n", table(("name", "unit", "nominal", "meaning"), rows)]
    return "\n".join(parts)


def _outcomes() -> str:
    return f"""# Outcomes

The column `outcome` of `flights/*.parquet` states how a flight ended.

{table(("outcome", "meaning"), ((code(o.code), SENTENCES[o]) for o in Outcome))}
The mission file has limits on altitude, and the vehicle file has limits on angle of attack and
sideslip. Loads, heat, bank and oscillation may be limited in both files; the tighter limit applies.
"""


def _exit_codes() -> str:
    return f"""# Exit codes

The exit codes are stable and can be used in scripts.

{table(("code", "meaning"), ((int(c), _EXIT_CODES[c]) for c in ExitCode))}"""


def _units() -> str:
    from abhv_mc.io import units

    rows = ((d.name, d.unit, code(d.example)) for d in DIMENSIONS)
    symbols = ", ".join(code(symbol) for symbol in units._UNITS)
    return f"""# Units

In a file, a quantity with a dimension includes its unit; a number without a unit is rejected,
so that degrees are not mistaken for radians. A unit is a product of symbols with integer
powers, such as `kg m2` or `ft/s2`; `/` divides by the next symbol only. Parquet columns are in SI,
angles in degrees if the name ends in `deg`.

{table(("quantity", "SI unit", "example"), rows)}
Symbols: {symbols}.
"""


def make() -> dict[str, str]:
    """Return the pages by their path."""
    return {
        "metrics.md": _metrics(),
        "channels.md": _channels(),
        "parameters.md": _parameters(),
        "outcomes.md": _outcomes(),
        "exit-codes.md": _exit_codes(),
        "units.md": _units(),
    }
