"""Pages from the code's tables: metrics, channels, parameters, outcomes, exit codes, units."""

from collections.abc import Iterable

from tables import code, table

from abhv_mc.cli.errors import ExitCode
from abhv_mc.flight.channels import CHANNELS, REFERENCE_CHANNELS, SOURCES, Signal
from abhv_mc.flight.metrics import MARGIN_VALUES, METRICS
from abhv_mc.flight.outcome import SENTENCES, Outcome
from abhv_mc.io.units import DIMENSIONS
from abhv_mc.plant.parameters import PARAMETERS

_EXIT_CODES = {
    ExitCode.DONE: "success",
    ExitCode.FAILED: "a requirement or a verification failed. A requirement counts only if its verdict is FAIL, and "
    "only for its own `controllers:` (by default the first of the campaign)",
    ExitCode.BAD_INPUT: "bad input: the message names file, line and column, the value found and the value expected. "
    "No file was written and no flight was run",
    ExitCode.INCOMPLETE: "interrupted or incomplete, or some flights failed to run. Completed flights are kept; run "
    "the same command to resume",
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

One column of `flights/*.parquet` each; a requirement, `keep.histories.by` and the report name them so. They are taken
at every control tick, from the start to the end of the flight. A flight that ends early has its metrics up to that
moment, its outcome says why, and every statistic and verdict counts it as a failure unless the requirement says
`ended_early: as_measured`. Errors of angle of attack and bank are against the controller's own command.

{table(("name", "unit", "meaning", "counted as", "bad", "group"), rows)}
`abhv-mc list metrics` prints the same table, and with a campaign's file the metrics that it declares.

Besides the channels, metrics may name these sources:

{_signals(others)}
## Stability margins

With `margins:` in the campaign, for as many flights as it names. A flight whose loop is unstable, or that ended
before, has 0.

{_signals(MARGIN_VALUES)}
## Of your own

[Metrics of your own](../user-laws.md#custom-metrics) are declared in the campaign and are metrics like any other.
"""


def _channels() -> str:
    return f"""# Channels

What histories, envelopes and replays record. A command has `_command` before its unit. The heat flux
is not a number where the vehicle file has no `reference.nose_radius`.

{_signals(CHANNELS)}
## Reference channels

The mission's reference, in `reference.parquet`, the same for every flight of a campaign.

{_signals(REFERENCE_CHANNELS)}"""


def _parameters() -> str:
    parts = [
        "# Parameters\n",
        "What a campaign may disperse, under `dispersions:`. A factor multiplies (nominal 1); an error is added, in",
        "its unit (nominal 0). Nominal values leave the flight unchanged to the last bit. The plant is dispersed;",
        "controllers see the nominal model only. `abhv-mc list parameters` prints this table. A campaign names",
        "`effector_0` to `effector_3` as the vehicle file does: `failure.right_elevon.stuck_time`.\n",
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

How a flight ended: the column `outcome` of `flights/*.parquet`.

{table(("outcome", "meaning"), ((code(o.code), SENTENCES[o]) for o in Outcome))}
Limits on altitude are the mission file's, those on angle of attack and sideslip the vehicle file's; loads, heat, bank
and oscillation may be limited in both, and the tighter one counts.
"""


def _exit_codes() -> str:
    return f"""# Exit codes

Scripts may rely on them.

{table(("code", "meaning"), ((int(c), _EXIT_CODES[c]) for c in ExitCode))}"""


def _units() -> str:
    from abhv_mc.io import units

    rows = ((d.name, d.unit, code(d.example)) for d in DIMENSIONS)
    symbols = ", ".join(code(symbol) for symbol in units._UNITS)
    return f"""# Units

In a file a quantity with a dimension carries its unit in the text; a number alone is refused, so that degrees are never
taken for radians. A unit is a product of symbols with whole powers, such as `kg m2` or `ft/s2`; `/` divides by the one
symbol after it. Inside the program and in Parquet columns everything is SI, angles in degrees where the name says so.

{table(("quantity", "SI unit", "example"), rows)}
Symbols: {symbols}.
"""


def make() -> dict[str, str]:
    """The pages by their path."""
    return {
        "metrics.md": _metrics(),
        "channels.md": _channels(),
        "parameters.md": _parameters(),
        "outcomes.md": _outcomes(),
        "exit-codes.md": _exit_codes(),
        "units.md": _units(),
    }
