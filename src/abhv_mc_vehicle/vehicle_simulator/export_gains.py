"""Export of controller gains along a mission as MATLAB, CSV or C arrays."""

from pathlib import Path

import numpy as np

from abhv_mc.io.atomic_write import atomic_write
from abhv_mc.io.csv_table import csv_text
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.kernel.laws.columns import LQR_GAINS, TIME, TLC_GAINS

_BUILT_IN = {"tlc": TLC_GAINS, "lqr": LQR_GAINS}


def check_gain_format(file: Path) -> None:
    """Raise InputError unless the suffix of a file name is .mat, .csv or .h."""
    if file.suffix not in (".mat", ".csv", ".h"):
        raise InputError(
            file, f"found the ending '{file.suffix}'", "a file name that ends in .mat, .csv or .h"
        )


def write_gains(file: Path, plan: FlightPlan) -> None:
    """Write gains [tick, gain] in SI units and radians, with their names and times (s).

    Numbers are written without rounding. Raise InputError if the suffix is unknown or the control
    law has no gains.
    """
    check_gain_format(file)
    names = _BUILT_IN.get(plan.commanding_law) or tuple(plan.gain_names.tolist())
    if not names:
        raise InputError(
            file, f"the control law {plan.controller} has no gains", "a control law with a design"
        )
    ticks = plan.timing.ticks + 1
    times = plan.reference[:ticks, TIME]
    gains = plan.gains[:ticks]
    with atomic_write(file) as temporary, temporary.open("wb") as stream:
        if file.suffix == ".mat":
            from scipy.io import savemat

            content = {"time_s": times, "gains": gains, "names": np.array(names, object)}
            savemat(stream, content, oned_as="column")
        elif file.suffix == ".h":
            stream.write(_make_header(plan.controller, names, times, gains).encode())
        else:
            rows = np.column_stack([times, gains]).tolist()
            stream.write(csv_text([["time_s", *names], *rows]).encode())


def _make_header(
    controller: str, names: tuple[str, ...], times: np.ndarray, gains: np.ndarray
) -> str:
    """Return a C99 header with the times, the gains and an enumeration of the gain columns."""
    columns = "".join(f"    GAIN_{name.upper()},\n" for name in names)
    rows = "".join(f"    {{{', '.join(map(repr, row))}}},\n" for row in gains.tolist())
    return (
        f"/* Gains of {controller} along its mission, in SI units and radians: "
        "gain[tick][GAIN_...] at gain_time_s[tick]. */\n"
        f"enum gain {{\n{columns}    GAINS\n}};\n"
        f"#define GAIN_TICKS {len(times)}\n"
        "static const double gain_time_s[GAIN_TICKS] = "
        f"{{{', '.join(map(repr, times.tolist()))}}};\n"
        f"static const double gain[GAIN_TICKS][GAINS] = {{\n{rows}}};\n"
    )
